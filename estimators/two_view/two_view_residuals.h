// Residuals of one match under a TwoViewModel, and derivatives of the model.
//
// Local parameters of a model, in this order: rotation w (R <- exp(w) R),
// translation, log scale, log focal length 1, log focal length 2. Logarithms
// keep scale and focal lengths positive.

#pragma once

#include "estimators/two_view/two_view_model.h"

#include <cmath>

#include <Eigen/Core>
#include <Eigen/LU>

namespace dgsfm {

enum TwoViewParam {
  kLogScaleParam = 6,
  kLogFocal1Param,
  kLogFocal2Param,
  kNumTwoViewParams
};

using TwoViewStep = Eigen::Matrix<double, kNumTwoViewParams, 1>;
using TwoViewMatrix =
    Eigen::Matrix<double, kNumTwoViewParams, kNumTwoViewParams>;

// The model moved by a step of local parameters.
TwoViewModel Retract(const TwoViewModel& model, const TwoViewStep& step);

// Derivative of the entries of the fundamental matrix (column-major) with
// respect to the local parameters.
Eigen::Matrix<double, 9, kNumTwoViewParams> FundamentalMatrixJacobian(
    const TwoViewModel& model);

// Points nearer to the camera plane than this share (squared) of their
// distance are behind for our purposes: their projections are beyond any image.
constexpr double kMinSqDepthRatio = 1e-6;

// Covariance (xx, xy, yy) of an image point for unit noise in its image.
using PointCovariance = Eigen::Vector3d;

inline PointCovariance UnitPointCovariance() { return {1, 0, 1}; }

// Covariance of an undistorted point whose noise in the distorted image has
// unit covariance, by the derivative of its pixel there.
inline PointCovariance UndistortedCovariance(
    const Eigen::Matrix2d& pixel_jacobian) {
  const Eigen::Matrix2d inverse = pixel_jacobian.inverse();
  const Eigen::Matrix2d covariance = inverse * inverse.transpose();
  return {covariance(0, 0), covariance(0, 1), covariance(1, 1)};
}

// Sampson error [px of the images] of (x1, x2), zero where its gradient
// vanishes (at both epipoles).
inline double SampsonError(
    const Eigen::Matrix3d& F,
    const Eigen::Vector2d& x1,
    const Eigen::Vector2d& x2,
    const PointCovariance& covariance1 = UnitPointCovariance(),
    const PointCovariance& covariance2 = UnitPointCovariance()) {
  const Eigen::Vector3d p = x1.homogeneous();
  const Eigen::Vector3d q = x2.homogeneous();
  const Eigen::Vector3d line2 = F * p;
  const Eigen::Vector2d line1 = F.leftCols<2>().transpose() * q;
  const double value = q.dot(line2);
  const auto sq_norm = [](const PointCovariance& c, double x, double y) {
    return c(0) * x * x + 2 * c(1) * x * y + c(2) * y * y;
  };
  const double sum = sq_norm(covariance2, line2.x(), line2.y()) +
                     sq_norm(covariance1, line1.x(), line1.y());
  return sum > 0 ? value / std::sqrt(sum) : 0;
}

// A point of view 1 with depth, seen from view 2.
struct Transfer {
  // Position in the frame of camera 2 [units of depth map 1].
  Eigen::Vector3d point;
  // The same minus the translation: moves in proportion to the depth.
  Eigen::Vector3d ray;
  // Projection minus matched image point [px].
  Eigen::Vector2d error_px;
  // log of the transferred over the scaled z-depth of the matched point [1].
  double log_depth_ratio = 0;
};

// False if the point is not in front of camera 2; the output is then not set.
// An unknown (zero) depth of the matched point leaves log_depth_ratio at zero.
// The transfer from view 2 to 1 is that of model.Inverse().
bool TransferMatch(const TwoViewModel& model,
                   const Eigen::Vector2d& x1,
                   double depth1,
                   const Eigen::Vector2d& x2,
                   double depth2,
                   Transfer* transfer);

// Derivative of the local parameters of model.Inverse() with respect to those
// of the model.
TwoViewMatrix InverseJacobian(const TwoViewModel& model);

}  // namespace dgsfm
