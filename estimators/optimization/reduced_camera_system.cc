#include "estimators/optimization/reduced_camera_system.h"

#include "colmap_ext/check.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace dgsfm {

namespace {

// Ratio of the eigenvalues of a point's information below which its position
// is not determined.
constexpr double kMinReciprocalCondition = 1e-12;
// Information that every parameter has at least, relative to what it would have
// with all others known: images that share no track have no common scale, which
// must not hide what is known about all else.
constexpr double kDamping = 1e-11;

// Covariance of a point with all cameras known; nothing if the observations do
// not determine its position.
std::optional<Eigen::Matrix3d> PointCovariance(
    const std::vector<LinearizedObservation>& observations) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const LinearizedObservation& observation : observations) {
    information +=
        observation.point_jacobian.transpose() * observation.point_jacobian;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(information);
  if (!(eigen.eigenvalues()(0) >
        kMinReciprocalCondition * eigen.eigenvalues()(2))) {
    return std::nullopt;
  }
  return information.inverse();
}

}  // namespace

ReducedCameraSystem::ReducedCameraSystem(int num_params)
    : information_(Eigen::MatrixXd::Zero(num_params, num_params)),
      gradient_(Eigen::VectorXd::Zero(num_params)) {}

void ReducedCameraSystem::AddPoint(
    const std::vector<LinearizedObservation>& observations) {
  Eigen::Vector3d point_gradient = Eigen::Vector3d::Zero();
  for (const LinearizedObservation& observation : observations) {
    DGSFM_CHECK(observation.camera_jacobian.cols() ==
                Eigen::Index(observation.params.size()));
    for (const int param : observation.params) {
      DGSFM_CHECK(param >= 0 && param < information_.rows())
          << "parameter " << param << " of " << information_.rows();
    }
    point_gradient +=
        observation.point_jacobian.transpose() * observation.residual;
  }
  const std::optional<Eigen::Matrix3d> point_covariance =
      PointCovariance(observations);
  if (!point_covariance) return;
  for (size_t k = 0; k < observations.size(); ++k) {
    const LinearizedObservation& observation = observations[k];
    const Eigen::Matrix<double, 2, 3> projected =
        observation.point_jacobian * *point_covariance;
    const Eigen::Vector2d residual =
        observation.residual - projected * point_gradient;
    for (size_t i = 0; i < observation.params.size(); ++i) {
      gradient_(observation.params[i]) +=
          observation.camera_jacobian.col(Eigen::Index(i)).dot(residual);
    }
    for (size_t l = k; l < observations.size(); ++l) {
      Eigen::Matrix2d core =
          -projected * observations[l].point_jacobian.transpose();
      if (l == k) core += Eigen::Matrix2d::Identity();
      AddBlock(observation, core, observations[l], /*both=*/l > k);
    }
  }
}

// J1^T core J2 and, of two observations, its transpose.
void ReducedCameraSystem::AddBlock(const LinearizedObservation& observation1,
                                   const Eigen::Matrix2d& core,
                                   const LinearizedObservation& observation2,
                                   bool both) {
  for (size_t j = 0; j < observation2.params.size(); ++j) {
    const Eigen::Vector2d right =
        core * observation2.camera_jacobian.col(Eigen::Index(j));
    const int param2 = observation2.params[j];
    for (size_t i = 0; i < observation1.params.size(); ++i) {
      const double value =
          observation1.camera_jacobian.col(Eigen::Index(i)).dot(right);
      const int param1 = observation1.params[i];
      information_(param1, param2) += value;
      if (both) information_(param2, param1) += value;
    }
  }
}

void ReducedCameraSystem::AddPrior(int param, double stddev, double deviation) {
  DGSFM_CHECK(param >= 0 && param < information_.rows());
  DGSFM_CHECK(stddev > 0) << "stddev = " << stddev;
  information_(param, param) += 1 / (stddev * stddev);
  gradient_(param) += deviation / (stddev * stddev);
}

std::optional<ReducedCameraSystem::Marginal> ReducedCameraSystem::MarginalOf(
    const std::vector<int>& params) const {
  // Scaled to a unit diagonal: parameters have different units.
  const Eigen::VectorXd scales =
      information_.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled =
      scales.asDiagonal() * information_ * scales.asDiagonal();
  scaled.diagonal().array() += kDamping;
  const Eigen::LDLT<Eigen::MatrixXd> factors(scaled);
  if (factors.info() != Eigen::Success || !factors.isPositive() ||
      !(factors.vectorD().minCoeff() > 1e-13)) {
    return std::nullopt;
  }
  const auto count = Eigen::Index(params.size());
  // Right-hand sides: a unit vector for each parameter, and the gradient.
  Eigen::MatrixXd columns =
      Eigen::MatrixXd::Zero(information_.rows(), count + 1);
  for (Eigen::Index i = 0; i < count; ++i) columns(params[i], i) = 1;
  columns.col(count) = -scales.cwiseProduct(gradient_);
  columns = factors.solve(columns).eval();
  Marginal marginal = {Eigen::VectorXd(count),
                       Eigen::MatrixXd(count, count),
                       Eigen::MatrixXd(count, information_.rows())};
  for (Eigen::Index i = 0; i < count; ++i) {
    const double scale = scales(params[i]);
    marginal.step(i) = scale * columns(params[i], count);
    marginal.inverse_rows.row(i) =
        scale * scales.cwiseProduct(columns.col(i)).transpose();
    for (Eigen::Index j = 0; j < count; ++j) {
      marginal.covariance(i, j) =
          scale * scales(params[j]) * columns(params[i], j);
    }
  }
  marginal.covariance =
      (marginal.covariance + marginal.covariance.transpose()).eval() / 2;
  return marginal;
}

std::vector<Eigen::MatrixX2d> ReducedCameraSystem::InfluencesOf(
    const Marginal& marginal,
    const std::vector<LinearizedObservation>& observations) {
  const std::optional<Eigen::Matrix3d> point_covariance =
      PointCovariance(observations);
  if (!point_covariance) return {};
  const Eigen::Index count = marginal.inverse_rows.rows();
  std::vector<Eigen::MatrixX2d> influences;
  Eigen::MatrixX3d by_point = Eigen::MatrixX3d::Zero(count, 3);
  for (const LinearizedObservation& observation : observations) {
    Eigen::MatrixX2d& influence =
        influences.emplace_back(Eigen::MatrixX2d::Zero(count, 2));
    for (size_t i = 0; i < observation.params.size(); ++i) {
      influence.noalias() +=
          marginal.inverse_rows.col(observation.params[i]) *
          observation.camera_jacobian.col(Eigen::Index(i)).transpose();
    }
    by_point.noalias() += influence * observation.point_jacobian;
  }
  by_point *= *point_covariance;
  for (size_t k = 0; k < observations.size(); ++k) {
    influences[k].noalias() -=
        by_point * observations[k].point_jacobian.transpose();
  }
  return influences;
}

}  // namespace dgsfm
