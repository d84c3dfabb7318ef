// Residuals of global positioning.

#pragma once

#include <Eigen/Core>

namespace dgsfm {

// Distance between a unit ray d and the direction v = X - c of a point from a
// camera centre with the scale eliminated [1]:
//
//   r(v) = d - alpha v,   alpha = max(0, d.v / v.v),
//
// the value at the best scale alpha of the BATA residual d - alpha v. Its norm
// is the sine of the angle between d and v, and 1 beyond a right angle, where
// alpha = 0, r = d and no gradient is left.
//
// With u = v / |v| and q = d.u > 0: r = d - q u, and from du = (I - u u^T) dv
// / |v| follows
//
//   dr/dv = -(q (I - u u^T) + u (d - q u)^T) / |v|.
//
// d - q u = r and u^T r = 0, so that the gradient of |r|^2 / 2 is -q r / |v|:
// the one that the problem has with its scales at their best.
//
// `by_point` may be null.
Eigen::Vector3d RayPointResidual(const Eigen::Vector3d& ray,
                                 const Eigen::Vector3d& point_from_center,
                                 Eigen::Matrix3d* by_point);

}  // namespace dgsfm
