// Information about cameras that is left when points are unknown too.

#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Whitened residual r(c, x) of an observation and its Jacobians over some of
// the camera parameters c and the point x.
struct LinearizedObservation {
  // Largest number of parameters of a pose and its intrinsics.
  static constexpr int kMaxNumParams = 18;
  using CameraJacobian = Eigen::
      Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, kMaxNumParams>;

  Eigen::Vector2d residual = Eigen::Vector2d::Zero();
  // Indices of the camera parameters it depends on, each at most once.
  std::vector<int> params;
  // 2 x params.size().
  CameraJacobian camera_jacobian;
  Eigen::Matrix<double, 2, 3> point_jacobian;
};

// The Schur complement S = U - W V^-1 W^T of the points in the normal matrix
// of a bundle adjustment (Triggs et al., Bundle Adjustment - A Modern
// Synthesis, Sec. 6.1), dense: 8 num_params^2 bytes; and the gradient of half
// the squared residuals that goes with it.
class ReducedCameraSystem {
 public:
  explicit ReducedCameraSystem(int num_params);

  // All observations of one point. They are left out if they do not
  // determine its position. Throws on parameters out of range and on sizes that
  // do not match.
  void AddPoint(const std::vector<LinearizedObservation>& observations);

  // Normal prior of one parameter, which is `deviation` off its mean. Throws
  // unless stddev > 0.
  void AddPrior(int param, double stddev, double deviation = 0);

  const Eigen::MatrixXd& Information() const { return information_; }

  // Marginal of some parameters, all others being unknown: Gauss-Newton step to
  // the minimum, -S^-1 g, covariance, S^-1, and the rows of S^-1, params.size()
  // x num_params. Nothing if S is numerically singular.
  struct Marginal {
    Eigen::VectorXd step;
    Eigen::MatrixXd covariance;
    Eigen::MatrixXd inverse_rows;
  };
  std::optional<Marginal> MarginalOf(const std::vector<int>& params) const;

  // Derivatives of the minimum's parameters by the residuals of the
  // observations of one point, params.size() x 2 each, up to their sign: a
  // residual that grows by d moves the parameters by -influence * d. Empty for
  // points that AddPoint leaves out.
  static std::vector<Eigen::MatrixX2d> InfluencesOf(
      const Marginal& marginal,
      const std::vector<LinearizedObservation>& observations);

 private:
  void AddBlock(const LinearizedObservation& observation1,
                const Eigen::Matrix2d& core,
                const LinearizedObservation& observation2,
                bool both);

  Eigen::MatrixXd information_;
  Eigen::VectorXd gradient_;
};

}  // namespace dgsfm
