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
  // What one standard deviation counts as [unit of the other residuals].
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

// The derivative of the centre of a camera by its pose, which moves to
// (exp(w) R, exp(w) (t - p) + p + d) with a pivot p.
Eigen::Matrix<double, 3, 6> CenterByPose(const Rigid3d& cam_from_world,
                                         const Eigen::Vector3d& pivot);

// That of a camera of a rig, cam_from_world = cam_from_rig * rig_from_world, by
// the pose of the rig with its pivot, and by that of the camera in it, whose
// pivot is its translation.
Eigen::Matrix<double, 3, 12> CenterByPoses(const Rigid3d& cam_from_rig,
                                           const Rigid3d& rig_from_world,
                                           const Eigen::Vector3d& rig_pivot);

}  // namespace dgsfm
