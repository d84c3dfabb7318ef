#include "estimators/two_view/two_view_residuals.h"

#include <cmath>

namespace dgsfm {
TwoViewModel Retract(const TwoViewModel& model, const TwoViewStep& step) {
  TwoViewModel moved = model;
  const Eigen::Vector3d w = step.head<3>();
  const double angle = w.norm();
  if (angle > 0) {
    // Re-normalising keeps rounding from adding up over many steps.
    moved.rotation =
        Eigen::Quaterniond(
            Eigen::AngleAxisd(angle, w / angle).toRotationMatrix() *
            model.rotation)
            .normalized()
            .toRotationMatrix();
  }
  moved.translation += step.segment<3>(3);
  moved.scale *= std::exp(step(kLogScaleParam));
  moved.focal1 *= std::exp(step(kLogFocal1Param));
  moved.focal2 *= std::exp(step(kLogFocal2Param));
  return moved;
}

Eigen::Matrix<double, 9, kNumTwoViewParams> FundamentalMatrixJacobian(
    const TwoViewModel& model) {
  const Eigen::Vector3d k1(1 / model.focal1, 1 / model.focal1, 1);
  const Eigen::Vector3d k2(1 / model.focal2, 1 / model.focal2, 1);
  const Eigen::Matrix3d cross_t = CrossMatrix(model.translation);
  Eigen::Matrix<double, 9, kNumTwoViewParams> jacobian;
  jacobian.setZero();
  const auto column = [&](int k) {
    return Eigen::Map<Eigen::Matrix3d>(jacobian.col(k).data());
  };
  for (int k = 0; k < 3; ++k) {
    const Eigen::Matrix3d axis_R =
        CrossMatrix(Eigen::Vector3d::Unit(k)) * model.rotation;
    column(k) = k2.asDiagonal() * (cross_t * axis_R) * k1.asDiagonal();
    column(3 + k) = k2.asDiagonal() * axis_R * k1.asDiagonal();
  }
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  column(kLogFocal1Param).leftCols<2>() = -F.leftCols<2>();
  column(kLogFocal2Param).topRows<2>() = -F.topRows<2>();
  return jacobian;
}

bool TransferMatch(const TwoViewModel& model,
                   const Eigen::Vector2d& x1,
                   double depth1,
                   const Eigen::Vector2d& x2,
                   double depth2,
                   Transfer* transfer) {
  const double ratio = depth1 / model.focal1;
  transfer->ray =
      model.rotation * Eigen::Vector3d(ratio * x1.x(), ratio * x1.y(), depth1);
  transfer->point = transfer->ray + model.translation;
  const double z = transfer->point.z();
  if (!(z > 0 && z * z > kMinSqDepthRatio * transfer->point.squaredNorm())) {
    return false;
  }
  transfer->error_px = (model.focal2 / z) * transfer->point.head<2>() - x2;
  transfer->log_depth_ratio =
      depth2 > 0 ? std::log(z / (model.scale * depth2)) : 0;
  return true;
}

TwoViewMatrix InverseJacobian(const TwoViewModel& model) {
  // (exp(w) R)^T = exp(-R^T w) R^T, and t' = -R^T t / s.
  const Eigen::Matrix3d inverse_rotation = model.rotation.transpose();
  TwoViewMatrix jacobian = TwoViewMatrix::Zero();
  jacobian.topLeftCorner<3, 3>() = -inverse_rotation;
  jacobian.block<3, 3>(3, 0) =
      -inverse_rotation * CrossMatrix(model.translation) / model.scale;
  jacobian.block<3, 3>(3, 3) = -inverse_rotation / model.scale;
  jacobian.block<3, 1>(3, kLogScaleParam) =
      inverse_rotation * model.translation / model.scale;
  jacobian(kLogScaleParam, kLogScaleParam) = -1;
  jacobian(kLogFocal1Param, kLogFocal2Param) = 1;
  jacobian(kLogFocal2Param, kLogFocal1Param) = 1;
  return jacobian;
}

}  // namespace dgsfm
