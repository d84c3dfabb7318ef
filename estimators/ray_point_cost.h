// Cost function of global positioning.

#pragma once

#include <Eigen/Core>
#include <ceres/sized_cost_function.h>

namespace dgsfm {

// Distance between a unit ray d and the direction of a point from a camera
// centre with the scale eliminated: the residual [1] of size 3 is
//
//   r(c, X) = d - alpha v,   v = X - c,   alpha = max(0, d.v / v.v),
//
// the value at the best scale alpha of the BATA residual d - alpha v. Its norm
// is the sine of the angle between d and v, and 1 beyond a right angle, where
// alpha = 0, r = d and no gradient is left.
//
// With u = v / |v| and q = d.u > 0: r = d - q u, and from du = (I - u u^T) dv
// / |v| follows
//
//   dr/dv = -(q (I - u u^T) + u (d - q u)^T) / |v|,   dr/dX = -dr/dc = dr/dv.
//
// d - q u = r and u^T r = 0, so that the gradient of |r|^2 / 2 is -q r / |v|:
// the one that the problem has with its scales at their best.
//
// Parameters: centre c (3), point X (3), both in the world frame.
class RayPointCostFunction : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  explicit RayPointCostFunction(const Eigen::Vector3d& ray_in_world)
      : ray_(ray_in_world) {}

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d ray_;
};

}  // namespace dgsfm
