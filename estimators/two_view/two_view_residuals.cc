#include "estimators/two_view/two_view_residuals.h"

#include <cmath>

namespace dgsfm {
namespace {

// Points nearer to the camera plane than this share (squared) of their
// distance are behind for our purposes: their projections are beyond any image.
constexpr double kMinSqDepthRatio = 1e-6;

}  // namespace

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
  const Eigen::Matrix3d cross_t = CrossProductMatrix(model.translation);
  Eigen::Matrix<double, 9, kNumTwoViewParams> jacobian;
  jacobian.setZero();
  const auto column = [&](int k) {
    return Eigen::Map<Eigen::Matrix3d>(jacobian.col(k).data());
  };
  for (int k = 0; k < 3; ++k) {
    const Eigen::Matrix3d axis_R =
        CrossProductMatrix(Eigen::Vector3d::Unit(k)) * model.rotation;
    column(k) = k2.asDiagonal() * (cross_t * axis_R) * k1.asDiagonal();
    column(3 + k) = k2.asDiagonal() * axis_R * k1.asDiagonal();
  }
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  column(kLogFocal1Param).leftCols<2>() = -F.leftCols<2>();
  column(kLogFocal2Param).topRows<2>() = -F.topRows<2>();
  return jacobian;
}

bool TransferMatch(TransferDirection direction,
                   const TwoViewModel& model,
                   const Eigen::Vector2d& x1,
                   double depth1,
                   const Eigen::Vector2d& x2,
                   double depth2,
                   Transfer* transfer) {
  const bool forward = direction == TransferDirection::FORWARD;
  const double scaled_depth2 = model.scale * depth2;
  if (forward) {
    const double ratio = depth1 / model.focal1;
    transfer->ray = model.rotation *
                    Eigen::Vector3d(ratio * x1.x(), ratio * x1.y(), depth1);
    transfer->point = transfer->ray + model.translation;
  } else {
    const double ratio = scaled_depth2 / model.focal2;
    const Eigen::Vector3d point2(ratio * x2.x(), ratio * x2.y(), scaled_depth2);
    transfer->ray = model.rotation.transpose() * point2;
    transfer->point = model.rotation.transpose() * (point2 - model.translation);
  }
  const double z = transfer->point.z();
  if (!(z > 0 && z * z > kMinSqDepthRatio * transfer->point.squaredNorm())) {
    return false;
  }
  transfer->error_px = ((forward ? model.focal2 : model.focal1) / z) *
                           transfer->point.head<2>() -
                       (forward ? x2 : x1);
  const double observed_depth = forward ? scaled_depth2 : depth1;
  transfer->log_depth_ratio =
      observed_depth > 0 ? std::log(z / observed_depth) : 0;
  return true;
}

TwoViewStep TransferGradient(TransferDirection direction,
                             const TwoViewModel& model,
                             const Transfer& transfer,
                             const Eigen::Vector2d& pixel_weights,
                             double log_depth_weight) {
  const bool forward = direction == TransferDirection::FORWARD;
  const double inverse_z = 1 / transfer.point.z();
  const double pixels_per_unit =
      (forward ? model.focal2 : model.focal1) * inverse_z;
  // By the log focal length of the image that the point is seen in.
  const double by_focal =
      pixels_per_unit * pixel_weights.dot(transfer.point.head<2>());
  // By the transferred point.
  const Eigen::Vector3d c(pixels_per_unit * pixel_weights.x(),
                          pixels_per_unit * pixel_weights.y(),
                          (log_depth_weight - by_focal) * inverse_z);
  TwoViewStep gradient;
  if (forward) {
    gradient.head<3>() = transfer.ray.cross(c);
    gradient.segment<3>(3) = c;
    gradient(kLogScaleParam) = -log_depth_weight;
    // The ray without its part along the optical axis of view 1, whose length
    // is the depth and does not change.
    const double depth1 = model.rotation.col(2).dot(transfer.ray);
    gradient(kLogFocal1Param) =
        depth1 * model.rotation.col(2).dot(c) - transfer.ray.dot(c);
    gradient(kLogFocal2Param) = by_focal;
  } else {
    const Eigen::Vector3d c2 = model.rotation * c;
    const Eigen::Vector3d point2 = model.rotation * transfer.ray;
    gradient.head<3>() = c2.cross(point2 - model.translation);
    gradient.segment<3>(3) = -c2;
    gradient(kLogScaleParam) = c.dot(transfer.ray);
    gradient(kLogFocal1Param) = by_focal;
    gradient(kLogFocal2Param) = -c2.head<2>().dot(point2.head<2>());
  }
  return gradient;
}

}  // namespace dgsfm
