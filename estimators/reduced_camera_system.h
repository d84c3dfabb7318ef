// Information about cameras that is left when points are unknown too.

#pragma once

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Whitened Jacobians of an observation: residual r(c, x) over some of the
// camera parameters c and the point x.
struct LinearizedObservation {
  // Indices of the camera parameters it depends on, each at most once.
  std::vector<int> params;
  // 2 x params.size().
  Eigen::Matrix2Xd camera_jacobian;
  Eigen::Matrix<double, 2, 3> point_jacobian;
};

// The Schur complement S = U - W V^-1 W^T of the points in the normal matrix
// of a bundle adjustment (Triggs et al., Bundle Adjustment - A Modern
// Synthesis, Sec. 6.1), dense: 8 num_params^2 bytes.
class ReducedCameraSystem {
 public:
  explicit ReducedCameraSystem(int num_params);

  // All observations of one point. Those of points whose position they do not
  // determine are left out: they say nothing reliable. Throws on parameters
  // out of range and on sizes that do not match.
  void AddPoint(const std::vector<LinearizedObservation>& observations);

  // Normal prior of one parameter. Throws unless stddev > 0.
  void AddPrior(int param, double stddev);

  const Eigen::MatrixXd& Information() const { return information_; }

 private:
  Eigen::MatrixXd information_;
};

// Blocks of the inverse of a symmetric positive definite matrix that belong to
// `params`; empty if it is numerically singular.
Eigen::MatrixXd MarginalCovariance(const Eigen::MatrixXd& information,
                                   const std::vector<int>& params);

}  // namespace dgsfm
