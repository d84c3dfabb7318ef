#include "estimators/reduced_camera_system.h"

#include "colmap_ext/check.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace dgsfm {

namespace {

// Ratio of the eigenvalues of a point's information below which its position
// is not determined.
constexpr double kMinReciprocalCondition = 1e-12;

}  // namespace

ReducedCameraSystem::ReducedCameraSystem(int num_params)
    : information_(Eigen::MatrixXd::Zero(num_params, num_params)) {}

void ReducedCameraSystem::AddPoint(
    const std::vector<LinearizedObservation>& observations) {
  Eigen::Matrix3d point_information = Eigen::Matrix3d::Zero();
  for (const LinearizedObservation& observation : observations) {
    DGSFM_CHECK(observation.camera_jacobian.cols() ==
                Eigen::Index(observation.params.size()));
    for (const int param : observation.params) {
      DGSFM_CHECK(param >= 0 && param < information_.rows())
          << "parameter " << param << " of " << information_.rows();
    }
    point_information +=
        observation.point_jacobian.transpose() * observation.point_jacobian;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(point_information);
  if (!(eigen.eigenvalues()(0) >
        kMinReciprocalCondition * eigen.eigenvalues()(2))) {
    return;
  }
  const Eigen::Matrix3d point_covariance = point_information.inverse();
  const auto add = [&](const LinearizedObservation& observation1,
                       const LinearizedObservation& observation2,
                       const Eigen::MatrixXd& block) {
    for (size_t i = 0; i < observation1.params.size(); ++i) {
      for (size_t j = 0; j < observation2.params.size(); ++j) {
        information_(observation1.params[i], observation2.params[j]) +=
            block(Eigen::Index(i), Eigen::Index(j));
      }
    }
  };
  for (const LinearizedObservation& observation1 : observations) {
    add(observation1,
        observation1,
        observation1.camera_jacobian.transpose() *
            observation1.camera_jacobian);
    const Eigen::MatrixX3d weights = observation1.camera_jacobian.transpose() *
                                     observation1.point_jacobian *
                                     point_covariance;
    for (const LinearizedObservation& observation2 : observations) {
      add(observation1,
          observation2,
          -weights * observation2.point_jacobian.transpose() *
              observation2.camera_jacobian);
    }
  }
}

void ReducedCameraSystem::AddPrior(int param, double stddev) {
  DGSFM_CHECK(param >= 0 && param < information_.rows());
  DGSFM_CHECK(stddev > 0) << "stddev = " << stddev;
  information_(param, param) += 1 / (stddev * stddev);
}

Eigen::MatrixXd MarginalCovariance(const Eigen::MatrixXd& information,
                                   const std::vector<int>& params) {
  // Scaled to a unit diagonal: parameters have different units.
  const Eigen::VectorXd scales =
      information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Eigen::MatrixXd> factors(scales.asDiagonal() * information *
                                             scales.asDiagonal());
  if (factors.info() != Eigen::Success || !factors.isPositive() ||
      !(factors.vectorD().minCoeff() > 1e-13)) {
    return {};
  }
  const auto count = Eigen::Index(params.size());
  Eigen::MatrixXd selection = Eigen::MatrixXd::Zero(information.rows(), count);
  for (Eigen::Index i = 0; i < count; ++i) selection(params[i], i) = 1;
  const Eigen::MatrixXd columns = factors.solve(selection);
  Eigen::MatrixXd covariance(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    covariance.row(i) = scales(params[i]) * columns.row(params[i]);
  }
  for (Eigen::Index i = 0; i < count; ++i)
    covariance.col(i) *= scales(params[i]);
  return (covariance + covariance.transpose()) / 2;
}

}  // namespace dgsfm
