#include "estimators/ray_point_cost.h"

namespace dgsfm {

bool RayPointCostFunction::Evaluate(double const* const* parameters,
                                    double* residuals,
                                    double** jacobians) const {
  const Eigen::Vector3d v = Eigen::Map<const Eigen::Vector3d>(parameters[1]) -
                            Eigen::Map<const Eigen::Vector3d>(parameters[0]);
  const double norm = v.norm();
  const double cosine = norm > 0 ? ray_.dot(v) / norm : 0;
  Eigen::Map<Eigen::Vector3d> residual(residuals);
  Eigen::Matrix3d J_residual_v = Eigen::Matrix3d::Zero();
  if (cosine > 0) {
    const Eigen::Vector3d direction = v / norm;
    residual = ray_ - cosine * direction;
    J_residual_v = (cosine * (direction * direction.transpose() -
                              Eigen::Matrix3d::Identity()) -
                    direction * residual.transpose()) /
                   norm;
  } else {
    residual = ray_;
  }
  for (int i = 0; jacobians != nullptr && i < 2; ++i) {
    if (jacobians[i] == nullptr) continue;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> J(jacobians[i]);
    J = (i == 0 ? -1 : 1) * J_residual_v;
  }
  return true;
}

}  // namespace dgsfm
