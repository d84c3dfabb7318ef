// Where a camera centre is by other means, e.g. GPS, as a term of a
// least-squares problem over poses and points.

#pragma once

#include "colmap_ext/rigid3.h"

#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace dgsfm {

struct CenterPrior {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  // L of the information L^T L [1 / unit of the scene]; zero = no prior.
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Zero();

  bool Exists() const { return !sqrt_information.isZero(0); }
};

// How much priors count.
struct CenterPriorWeight {
  // Of a deviation by one standard deviation [unit of the other residuals].
  double weight = 0;
  // Scale of the Cauchy loss [standard deviations].
  double loss_scale = 2;
};

// w^2 b^2 log(1 + |L (c - p)|^2 / b^2) / 2 for a centre c.
double CenterPriorCost(const CenterPrior& prior,
                       const CenterPriorWeight& weight,
                       const Eigen::Vector3d& center);

double CenterPriorCost(const CenterPrior& prior,
                       const CenterPriorWeight& weight,
                       const Rigid3d& cam_from_world);

// Adds the gradient and the Gauss-Newton approximation of the Hessian, lower
// triangle, of the cost by the columns that the centre depends on; negative
// columns are constants. by_columns: 3 x columns.size().
void LinearizeCenterPrior(const CenterPrior& prior,
                          const CenterPriorWeight& weight,
                          const Eigen::Vector3d& center,
                          const Eigen::Matrix3Xd& by_columns,
                          const int* columns,
                          std::vector<Eigen::Triplet<double>>* hessian,
                          Eigen::VectorXd* gradient);

// The same by the six columns of a pose, which moves by (exp(w) R, t + dt).
void LinearizeCenterPrior(const CenterPrior& prior,
                          const CenterPriorWeight& weight,
                          const Rigid3d& cam_from_world,
                          const int* columns,
                          std::vector<Eigen::Triplet<double>>* hessian,
                          Eigen::VectorXd* gradient);

}  // namespace dgsfm
