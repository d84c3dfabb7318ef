#include "estimators/optimization/center_prior.h"

#include "estimators/rotation_vector.h"

#include <cmath>

namespace dgsfm {

double CenterPriorCost(const CenterPrior& prior,
                       const CenterPriorWeight& weight,
                       const Eigen::Vector3d& center) {
  const double squared_scale = weight.loss_scale * weight.loss_scale;
  const double squared_error =
      (prior.sqrt_information * (center - prior.center)).squaredNorm();
  return 0.5 * weight.weight * weight.weight * squared_scale *
         std::log1p(squared_error / squared_scale);
}

double CenterPriorCost(const CenterPrior& prior,
                       const CenterPriorWeight& weight,
                       const Rigid3d& cam_from_world) {
  if (!prior.Exists()) return 0;
  return CenterPriorCost(prior, weight, cam_from_world.TargetOriginInSource());
}

void LinearizeCenterPrior(const CenterPrior& prior,
                          const CenterPriorWeight& weight,
                          const Eigen::Vector3d& center,
                          const Eigen::Matrix3Xd& by_columns,
                          const int* columns,
                          std::vector<Eigen::Triplet<double>>* hessian,
                          Eigen::VectorXd* gradient) {
  if (!prior.Exists()) return;
  const Eigen::Vector3d error =
      prior.sqrt_information * (center - prior.center);
  const double factor =
      weight.weight * weight.weight /
      (1 + error.squaredNorm() / (weight.loss_scale * weight.loss_scale));
  const Eigen::Matrix3Xd jacobian = prior.sqrt_information * by_columns;
  const Eigen::MatrixXd product = factor * jacobian.transpose() * jacobian;
  const Eigen::VectorXd gradient_part = factor * jacobian.transpose() * error;
  for (Eigen::Index i = 0; i < by_columns.cols(); ++i) {
    if (columns[i] < 0) continue;
    (*gradient)(columns[i]) += gradient_part(i);
    for (Eigen::Index j = 0; j < by_columns.cols(); ++j) {
      if (columns[j] < 0 || columns[j] > columns[i]) continue;
      hessian->emplace_back(columns[i], columns[j], product(i, j));
    }
  }
}

Eigen::Matrix<double, 3, 6> CenterByPose(const Rigid3d& cam_from_world,
                                         const Eigen::Vector3d& pivot) {
  const Eigen::Matrix3d world_from_cam =
      cam_from_world.rotation.toRotationMatrix().transpose();
  // The centre -R^T t moves by -R^T ([p]_x w + d).
  Eigen::Matrix<double, 3, 6> by_pose;
  by_pose << -world_from_cam * CrossMatrix(pivot), -world_from_cam;
  return by_pose;
}

Eigen::Matrix<double, 3, 12> CenterByPoses(const Rigid3d& cam_from_rig,
                                           const Rigid3d& rig_from_world,
                                           const Eigen::Vector3d& rig_pivot) {
  const Eigen::Matrix3d world_from_rig =
      rig_from_world.rotation.toRotationMatrix().transpose();
  const Eigen::Vector3d center_in_rig = cam_from_rig.TargetOriginInSource();
  // The centre R^T (c - t) moves by R^T ([c - p]_x w - d + dc).
  Eigen::Matrix<double, 3, 12> by_poses;
  by_poses << world_from_rig * CrossMatrix(center_in_rig - rig_pivot),
      -world_from_rig,
      world_from_rig * CenterByPose(cam_from_rig, cam_from_rig.translation);
  return by_poses;
}

}  // namespace dgsfm
