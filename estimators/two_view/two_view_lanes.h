// Residuals of eight matches at a time under a TwoViewModel, with analytic
// derivatives.

#pragma once

#include "estimators/lanes.h"
#include "estimators/two_view/two_view_data.h"
#include "estimators/two_view/two_view_depth_field.h"
#include "estimators/two_view/two_view_model.h"
#include "estimators/two_view/two_view_residuals.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct MatchLanes {
  Lanes x1[2], x2[2];
  Lanes covariance1[3], covariance2[3];
  // 1 and 0 where depths are unknown.
  Lanes depth1, log_depth2;
  // 1 or 0; the last lanes of a pair may hold no match.
  Lanes is_match;
  Lanes has_depths;
};

std::vector<MatchLanes> CreateMatchLanes(const TwoViewData& data);

// Sampson error [px] and, if not null, its derivative by the entries of F (both
// column-major). Zero where its gradient vanishes (at both epipoles).
DGSFM_INLINE Lanes SampsonErrors(const double* F,
                                 const MatchLanes& match,
                                 Lanes (*slope)[9]) {
  const Lanes& u1 = match.x1[0];
  const Lanes& v1 = match.x1[1];
  const Lanes& u2 = match.x2[0];
  const Lanes& v2 = match.x2[1];
  const Lanes line2[3] = {F[0] * u1 + F[3] * v1 + F[6],
                          F[1] * u1 + F[4] * v1 + F[7],
                          F[2] * u1 + F[5] * v1 + F[8]};
  const Lanes line1[2] = {F[0] * u2 + F[1] * v2 + F[2],
                          F[3] * u2 + F[4] * v2 + F[5]};
  const Lanes value = u2 * line2[0] + v2 * line2[1] + line2[2];
  const Lanes a[2] = {
      match.covariance2[0] * line2[0] + match.covariance2[1] * line2[1],
      match.covariance2[1] * line2[0] + match.covariance2[2] * line2[1]};
  const Lanes b[2] = {
      match.covariance1[0] * line1[0] + match.covariance1[1] * line1[1],
      match.covariance1[1] * line1[0] + match.covariance1[2] * line1[1]};
  const Lanes sq_norm =
      a[0] * line2[0] + a[1] * line2[1] + b[0] * line1[0] + b[1] * line1[1];
  const Lanes sq_inverse_norm = sq_norm > 0.0 ? 1 / sq_norm : Lanes{};
  const Lanes inverse_norm = Sqrt(sq_inverse_norm);
  if (slope) {
    const Lanes ratio = value * sq_inverse_norm;
    const Lanes left[3] = {inverse_norm * (u2 - ratio * a[0]),
                           inverse_norm * (v2 - ratio * a[1]),
                           inverse_norm};
    const Lanes right[2] = {inverse_norm * ratio * b[0],
                            inverse_norm * ratio * b[1]};
    (*slope)[0] = u1 * left[0] - right[0] * u2;
    (*slope)[1] = u1 * left[1] - right[0] * v2;
    (*slope)[2] = u1 * left[2] - right[0];
    (*slope)[3] = v1 * left[0] - right[1] * u2;
    (*slope)[4] = v1 * left[1] - right[1] * v2;
    (*slope)[5] = v1 * left[2] - right[1];
    (*slope)[6] = left[0];
    (*slope)[7] = left[1];
    (*slope)[8] = left[2];
  }
  return value * inverse_norm;
}

// Points of view 1 with depth, seen from view 2.
struct TransferLanes {
  Lanes ray[3], point[3];
  Lanes inverse_z;
  // 1 or 0; elsewhere the rest is finite and has no meaning.
  Lanes is_in_front;
};

DGSFM_INLINE TransferLanes TransferPoints(const TwoViewModel& model,
                                          const MatchLanes& match,
                                          const Lanes& depth1) {
  const double* R = model.rotation.data();
  const Lanes ratio = depth1 * (1 / model.focal1);
  const Lanes x = ratio * match.x1[0];
  const Lanes y = ratio * match.x1[1];
  TransferLanes transfer;
  for (int k = 0; k < 3; ++k) {
    transfer.ray[k] = R[k] * x + R[3 + k] * y + R[6 + k] * depth1;
    transfer.point[k] = transfer.ray[k] + model.translation[k];
  }
  const Lanes sq_z = transfer.point[2] * transfer.point[2];
  const Lanes sq_norm = transfer.point[0] * transfer.point[0] +
                        transfer.point[1] * transfer.point[1] + sq_z;
  const Lanes one = Lanes{} + 1.0;
  transfer.is_in_front = transfer.point[2] > 0.0
                             ? sq_z > kMinSqDepthRatio * sq_norm ? one : Lanes{}
                             : Lanes{};
  transfer.point[2] = transfer.is_in_front > 0.0 ? transfer.point[2] : one;
  transfer.inverse_z = 1 / transfer.point[2];
  return transfer;
}

template <typename Number>
DGSFM_INLINE Lanes Dot(const Number* a, const Lanes* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Derivative of
//   pixel_weights . transferred point + log_depth_weight * log of its depth
// with respect to the parameters of a model.
DGSFM_INLINE void TransferGradient(const TwoViewModel& model,
                                   const TransferLanes& transfer,
                                   const Lanes (&pixel_weights)[2],
                                   const Lanes& log_depth_weight,
                                   Lanes* gradient) {
  const Lanes* ray = transfer.ray;
  const Lanes pixels_per_unit = model.focal2 * transfer.inverse_z;
  const Lanes by_focal2 =
      pixels_per_unit * (pixel_weights[0] * transfer.point[0] +
                         pixel_weights[1] * transfer.point[1]);
  const Lanes by_point[3] = {
      pixels_per_unit * pixel_weights[0],
      pixels_per_unit * pixel_weights[1],
      (log_depth_weight - by_focal2) * transfer.inverse_z};
  gradient[0] = ray[1] * by_point[2] - ray[2] * by_point[1];
  gradient[1] = ray[2] * by_point[0] - ray[0] * by_point[2];
  gradient[2] = ray[0] * by_point[1] - ray[1] * by_point[0];
  for (int k = 0; k < 3; ++k) gradient[3 + k] = by_point[k];
  gradient[kLogScaleParam] = -log_depth_weight;
  // The focal length moves the ray but for its part along the optical axis of
  // view 1, whose length is the depth.
  const double* axis1 = model.rotation.data() + 6;
  gradient[kLogFocal1Param] =
      Dot(axis1, ray) * Dot(axis1, by_point) - Dot(ray, by_point);
  gradient[kLogFocal2Param] = by_focal2;
}

// A depth field at the matches of one view.
struct FieldLanes {
  Lanes basis[kNumDepthFieldTerms];
  Lanes value;
};

// The field is zero where the unit is.
DGSFM_INLINE FieldLanes EvaluateField(const Lanes (&points)[2],
                                      double unit_px,
                                      const double* coefficients) {
  FieldLanes field = {};
  if (unit_px == 0) return field;
  const double inverse_unit = 1 / unit_px;
  const Lanes x = points[0] * inverse_unit;
  const Lanes y = points[1] * inverse_unit;
  const Lanes basis[kNumDepthFieldTerms] = {x, y, x * x, x * y, y * y};
  for (int k = 0; k < kNumDepthFieldTerms; ++k) {
    field.basis[k] = basis[k];
    field.value += coefficients[k] * basis[k];
  }
  return field;
}

// How the depths of a pair are whitened (DepthTerm::WHITENED).
struct WhiteningOptions {
  // Noise of an image point [px] and of log depth [1].
  double stddev_px;
  double log_depth_stddev;
  // Lengths in which the depth fields are about one over the image [px]; zero
  // without fields.
  double field_unit1_px;
  double field_unit2_px;
};

// Turns a transfer into the whitened residual (L^-1 r for L L^T = its
// covariance).
struct WhiteningLanes {
  // Direction of the epipolar line.
  Lanes direction[2];
  // Zero if the point cannot be transferred.
  Lanes w11;
  Lanes w21, w22;
  // Derivatives of the part along the line [px] and of the log of the
  // transferred depth by the log depth.
  Lanes shift, slope;
};

DGSFM_INLINE WhiteningLanes WhiteningAt(const TwoViewModel& model,
                                        const double* F,
                                        const WhiteningOptions& options,
                                        const MatchLanes& match,
                                        const TransferLanes& transfer) {
  // How the transferred point and the log of its depth move with the log of the
  // depth in map 1.
  const Lanes slope = transfer.ray[2] * transfer.inverse_z;
  const Lanes pixels_per_unit = model.focal2 * transfer.inverse_z;
  const Lanes line[2] = {F[0] * match.x1[0] + F[3] * match.x1[1] + F[6],
                         F[1] * match.x1[0] + F[4] * match.x1[1] + F[7]};
  const Lanes length = Sqrt(line[0] * line[0] + line[1] * line[1]);
  WhiteningLanes whitening;
  // The line is zero without translation; any direction serves then.
  whitening.direction[0] = length > 0.0 ? line[1] / length : Lanes{} + 1.0;
  whitening.direction[1] = length > 0.0 ? -line[0] / length : Lanes{};
  whitening.shift = Lanes{};
  for (int k = 0; k < 2; ++k) {
    whitening.shift += whitening.direction[k] * pixels_per_unit *
                       (transfer.ray[k] - transfer.point[k] * slope);
  }
  whitening.slope = slope;
  const Lanes shift_stddev = whitening.shift * options.log_depth_stddev;
  const Lanes slope_stddev = slope * options.log_depth_stddev;
  // Sum of the variances of the two points per coordinate, in the mean over all
  // directions.
  const Lanes point_variance =
      0.5 * (match.covariance1[0] + match.covariance1[2] +
             match.covariance2[0] + match.covariance2[2]);
  // Cholesky factor of the 2 x 2 covariance, whose second variance is at least
  // that of map 2: rounding must not make it less.
  const Lanes l11 =
      Sqrt(point_variance * (options.stddev_px * options.stddev_px) +
           shift_stddev * shift_stddev);
  whitening.w11 = 1 / l11;
  const Lanes l21 = shift_stddev * slope_stddev * whitening.w11;
  const Lanes l22 = Sqrt(Max(slope_stddev * slope_stddev - l21 * l21, Lanes{}) +
                         options.log_depth_stddev * options.log_depth_stddev);
  whitening.w22 = 1 / l22;
  whitening.w21 = -l21 * whitening.w11 * whitening.w22;
  whitening.w11 = transfer.is_in_front > 0.0 ? whitening.w11 : Lanes{};
  return whitening;
}

}  // namespace dgsfm
