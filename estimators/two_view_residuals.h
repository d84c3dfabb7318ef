// Residuals of one match under a TwoViewModel, with analytic Jacobians.
//
// Local parameters of a model, in this order: rotation w (R <- exp(w) R),
// translation, log scale, log focal length 1, log focal length 2. Logarithms
// keep scale and focal lengths positive.

#pragma once

#include "estimators/two_view_model.h"

#include <cmath>

#include <Eigen/Core>

namespace dgsfm {

constexpr int kNumTwoViewParams = 9;
constexpr int kLogScaleParam = 6;
constexpr int kLogFocal1Param = 7;
constexpr int kLogFocal2Param = 8;

using TwoViewStep = Eigen::Matrix<double, kNumTwoViewParams, 1>;

// The model moved by a step of local parameters.
TwoViewModel Retract(const TwoViewModel& model, const TwoViewStep& step);

// Derivative of the entries of the fundamental matrix (column-major) with
// respect to the local parameters.
Eigen::Matrix<double, 9, kNumTwoViewParams> FundamentalMatrixJacobian(
    const TwoViewModel& model);

// Sampson error [px] of (x1, x2), zero where its gradient vanishes (at both
// epipoles). With `gradient`, its derivative with respect to the entries of F.
inline double SampsonError(const Eigen::Matrix3d& F,
                           const Eigen::Vector2d& x1,
                           const Eigen::Vector2d& x2,
                           Eigen::Matrix3d* gradient = nullptr) {
  const Eigen::Vector3d p = x1.homogeneous();
  const Eigen::Vector3d q = x2.homogeneous();
  Eigen::Vector3d a = F * p;
  Eigen::Vector3d b = F.transpose() * q;
  const double value = q.dot(a);
  a(2) = b(2) = 0;
  const double sq_norm = a.squaredNorm() + b.squaredNorm();
  if (!(sq_norm > 0)) {
    if (gradient) gradient->setZero();
    return 0;
  }
  const double inverse_norm = 1 / std::sqrt(sq_norm);
  if (gradient) {
    const double ratio = value / sq_norm;
    *gradient = ((inverse_norm * (q - ratio * a)) * p.transpose()) -
                ((inverse_norm * ratio) * q) * b.transpose();
  }
  return value * inverse_norm;
}

// A point of one view with depth, seen from the other.
struct Transfer {
  // Position in the other camera frame [units of depth map 1].
  Eigen::Vector3d point;
  // The same minus the translation part: moves in proportion to the depth.
  Eigen::Vector3d ray;
  // Projection minus matched image point [px].
  Eigen::Vector2d error_px;
  // log of the transferred over the scaled z-depth of the matched point [1].
  double log_depth_ratio = 0;
};

// Rows error_px (2), log_depth_ratio (1).
using TransferJacobian = Eigen::Matrix<double, 3, kNumTwoViewParams>;

// From view 1 to 2 (forward), respectively from 2 to 1 (backward). False if
// the point is not in front of the other camera; the outputs are then not set.
// An unknown (zero) depth of the matched point leaves log_depth_ratio at zero.
bool TransferForward(const TwoViewModel& model,
                     const Eigen::Vector2d& x1,
                     double depth1,
                     const Eigen::Vector2d& x2,
                     double depth2,
                     Transfer* transfer,
                     TransferJacobian* jacobian = nullptr);
bool TransferBackward(const TwoViewModel& model,
                      const Eigen::Vector2d& x1,
                      double depth1,
                      const Eigen::Vector2d& x2,
                      double depth2,
                      Transfer* transfer,
                      TransferJacobian* jacobian = nullptr);

}  // namespace dgsfm
