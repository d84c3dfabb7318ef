// Cost functor of view-graph calibration.

#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/SVD>
#include <ceres/autodiff_cost_function.h>

namespace dgsfm {

// Normalised Kruppa residual [1] of size 3 of a fundamental matrix between
// cameras of focal lengths f_1 and f_2. With F = U diag(a, b, 0) V^T and
// W_i = diag(f_i^2, f_i^2, 1), Kruppa's equations
//
//   F W_1 F^T  ~  [u_3]x W_2 [u_3]x^T
//
// read in the basis u_1, u_2, where u_1 x u_2 = +-u_3, as
//
//   ( a^2 v_1 W_1 v_1   a b v_1 W_1 v_2 )     (  u_2 W_2 u_2  -u_1 W_2 u_2 )
//   ( a b v_1 W_1 v_2   b^2 v_2 W_1 v_2 )  ~  ( -u_1 W_2 u_2   u_1 W_2 u_1 )
//
// (Hartley, PAMI 1997). Residual: the difference of both sides, each divided
// by its Frobenius norm; off-diagonal entries times sqrt(2).
//
// Parameters: logarithms of f_1 and f_2 in units given for each camera; only
// one for a pair of images of the same camera.
class KruppaCostFunctor {
 public:
  // F for points in pixels relative to the principal points, not zero. With
  // units near the focal lengths [px] it turns into nearly an essential
  // matrix, which weights directions alike.
  KruppaCostFunctor(const Eigen::Matrix3d& F,
                    double unit1_px,
                    double unit2_px) {
    const Eigen::Vector3d units1(unit1_px, unit1_px, 1);
    const Eigen::Vector3d units2(unit2_px, unit2_px, 1);
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
        units2.asDiagonal() * F * units1.asDiagonal(),
        Eigen::ComputeFullU | Eigen::ComputeFullV);
    // Only the ratio of a and b matters.
    v1_ = svd.matrixV().col(0);
    v2_ = svd.matrixV().col(1) *
          (svd.singularValues()(1) / svd.singularValues()(0));
    u1_ = svd.matrixU().col(0);
    u2_ = svd.matrixU().col(1);
  }

  static ceres::CostFunction* Create(const Eigen::Matrix3d& F,
                                     double unit1_px,
                                     double unit2_px,
                                     bool same_camera) {
    auto* functor = new KruppaCostFunctor(F, unit1_px, unit2_px);
    if (same_camera) {
      return new ceres::AutoDiffCostFunction<KruppaCostFunctor, 3, 1>(functor);
    }
    return new ceres::AutoDiffCostFunction<KruppaCostFunctor, 3, 1, 1>(functor);
  }

  template <typename T>
  bool operator()(const T* log_focal1, const T* log_focal2, T* residual) const {
    using std::exp;
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Vector left = Normalized(exp(2.0 * *log_focal1), v1_, v2_, 1);
    const Vector right = Normalized(exp(2.0 * *log_focal2), u2_, u1_, -1);
    Eigen::Map<Vector> difference(residual);
    difference = left - right;
    return true;
  }

  template <typename T>
  bool operator()(const T* log_focal, T* residual) const {
    return (*this)(log_focal, log_focal, residual);
  }

 private:
  // (x W x, sqrt(2) sign x W y, y W y) over its norm, W = diag(f^2, f^2, 1).
  template <typename T>
  static Eigen::Matrix<T, 3, 1> Normalized(const T& sq_focal,
                                           const Eigen::Vector3d& x,
                                           const Eigen::Vector3d& y,
                                           double sign) {
    const auto product = [&](const Eigen::Vector3d& p,
                             const Eigen::Vector3d& q) {
      return sq_focal * (p.x() * q.x() + p.y() * q.y()) + p.z() * q.z();
    };
    const Eigen::Matrix<T, 3, 1> entries(
        product(x, x), product(x, y) * (M_SQRT2 * sign), product(y, y));
    return entries / entries.norm();
  }

  Eigen::Vector3d u1_, u2_, v1_, v2_;
};

}  // namespace dgsfm
