#include "estimators/optimization/ray_point_residual.h"

namespace dgsfm {

Eigen::Vector3d RayPointResidual(const Eigen::Vector3d& ray,
                                 const Eigen::Vector3d& point_from_center,
                                 Eigen::Matrix3d* by_point) {
  const double norm = point_from_center.norm();
  const double cosine = norm > 0 ? ray.dot(point_from_center) / norm : 0;
  if (!(cosine > 0)) {
    if (by_point) by_point->setZero();
    return ray;
  }
  const Eigen::Vector3d direction = point_from_center / norm;
  const Eigen::Vector3d residual = ray - cosine * direction;
  if (by_point) {
    *by_point = (cosine * (direction * direction.transpose() -
                           Eigen::Matrix3d::Identity()) -
                 direction * residual.transpose()) /
                norm;
  }
  return residual;
}

}  // namespace dgsfm
