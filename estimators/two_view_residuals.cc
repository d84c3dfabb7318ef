#include "estimators/two_view_residuals.h"

#include <cmath>

namespace dgsfm {
namespace {

// Points nearer to the camera plane than this share of their distance are
// behind for our purposes: their projections are beyond any image.
constexpr double kMinDepthRatio = 1e-3;

bool Project(const Eigen::Vector3d& point,
             double focal,
             const Eigen::Vector2d& observed,
             double observed_depth,
             Transfer* transfer) {
  if (!(point.z() > kMinDepthRatio * point.norm())) return false;
  transfer->point = point;
  transfer->error_px = (focal / point.z()) * point.head<2>() - observed;
  transfer->log_depth_ratio =
      observed_depth > 0 ? std::log(point.z() / observed_depth) : 0;
  return true;
}

// On entry the derivative of the point, on return that of what Project made.
void ChainProjection(const Eigen::Vector3d& point,
                     double focal,
                     int log_focal_param,
                     bool has_observed_depth,
                     TransferJacobian* jacobian) {
  const double inverse_z = 1 / point.z();
  const Eigen::Vector2d projected = focal * inverse_z * point.head<2>();
  jacobian->row(2) *= inverse_z;
  jacobian->topRows<2>() *= focal * inverse_z;
  jacobian->topRows<2>() -= projected * jacobian->row(2);
  jacobian->block<2, 1>(0, log_focal_param) += projected;
  if (!has_observed_depth) jacobian->row(2).setZero();
}

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

bool TransferForward(const TwoViewModel& model,
                     const Eigen::Vector2d& x1,
                     double depth1,
                     const Eigen::Vector2d& x2,
                     double depth2,
                     Transfer* transfer,
                     TransferJacobian* jacobian) {
  const Eigen::Vector3d point1(
      depth1 * x1.x() / model.focal1, depth1 * x1.y() / model.focal1, depth1);
  transfer->ray = model.rotation * point1;
  if (!Project(transfer->ray + model.translation,
               model.focal2,
               x2,
               model.scale * depth2,
               transfer)) {
    return false;
  }
  if (jacobian) {
    jacobian->leftCols<3>() = -CrossProductMatrix(transfer->ray);
    jacobian->middleCols<3>(3).setIdentity();
    jacobian->col(kLogScaleParam).setZero();
    jacobian->col(kLogFocal1Param) =
        -(model.rotation.leftCols<2>() * point1.head<2>());
    jacobian->col(kLogFocal2Param).setZero();
    ChainProjection(
        transfer->point, model.focal2, kLogFocal2Param, depth2 > 0, jacobian);
    if (depth2 > 0) (*jacobian)(2, kLogScaleParam) -= 1;
  }
  return true;
}

bool TransferBackward(const TwoViewModel& model,
                      const Eigen::Vector2d& x1,
                      double depth1,
                      const Eigen::Vector2d& x2,
                      double depth2,
                      Transfer* transfer,
                      TransferJacobian* jacobian) {
  const double depth = model.scale * depth2;
  const Eigen::Vector3d point2(
      depth * x2.x() / model.focal2, depth * x2.y() / model.focal2, depth);
  const Eigen::Matrix3d inverse_rotation = model.rotation.transpose();
  transfer->ray = inverse_rotation * point2;
  const Eigen::Vector3d point2_minus_t = point2 - model.translation;
  if (!Project(inverse_rotation * point2_minus_t,
               model.focal1,
               x1,
               depth1,
               transfer)) {
    return false;
  }
  if (jacobian) {
    jacobian->leftCols<3>() =
        inverse_rotation * CrossProductMatrix(point2_minus_t);
    jacobian->middleCols<3>(3) = -inverse_rotation;
    jacobian->col(kLogScaleParam) = transfer->ray;
    jacobian->col(kLogFocal1Param).setZero();
    jacobian->col(kLogFocal2Param) =
        -(inverse_rotation.leftCols<2>() * point2.head<2>());
    ChainProjection(
        transfer->point, model.focal1, kLogFocal1Param, depth1 > 0, jacobian);
  }
  return true;
}

}  // namespace dgsfm
