#include "estimators/optimization/reduced_camera_system.h"

#include <random>
#include <stdexcept>

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(ReducedCameraSystem, MarginalIsThatOfTheWholeSystem) {
  constexpr int kNumCameras = 4;
  constexpr int kNumPoints = 12;
  constexpr int kNumCameraParams = 3;
  constexpr int kSize = kNumCameras * kNumCameraParams;
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto random = [&] { return uniform(generator); };
  ReducedCameraSystem system(kSize);
  Eigen::MatrixXd whole =
      Eigen::MatrixXd::Zero(kSize + 3 * kNumPoints, kSize + 3 * kNumPoints);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(whole.rows());
  for (int point = 0; point < kNumPoints; ++point) {
    std::vector<LinearizedObservation> observations;
    for (int camera = 0; camera < kNumCameras; ++camera) {
      LinearizedObservation& observation = observations.emplace_back();
      // The first parameter is shared by all cameras.
      observation.params = {
          0, camera * kNumCameraParams + 1, camera * kNumCameraParams + 2};
      observation.camera_jacobian =
          Eigen::Matrix2Xd::NullaryExpr(2, kNumCameraParams, random);
      observation.point_jacobian =
          Eigen::Matrix<double, 2, 3>::NullaryExpr(random);
      observation.residual = Eigen::Vector2d::NullaryExpr(random);
      Eigen::MatrixXd row = Eigen::MatrixXd::Zero(2, whole.cols());
      for (int i = 0; i < kNumCameraParams; ++i) {
        row.col(observation.params[i]) = observation.camera_jacobian.col(i);
      }
      row.middleCols<3>(kSize + 3 * point) = observation.point_jacobian;
      whole += row.transpose() * row;
      gradient += row.transpose() * observation.residual;
    }
    system.AddPoint(observations);
  }
  for (int param = 0; param < kSize; ++param) {
    system.AddPrior(param, 0.5, 0.1 * param);
    whole(param, param) += 4;
    gradient(param) += 4 * 0.1 * param;
  }
  const std::vector<int> params = {0, 4, 11};
  const auto marginal = system.MarginalOf(params);
  const Eigen::MatrixXd expected = whole.inverse();
  const Eigen::VectorXd expected_step = -expected * gradient;
  ASSERT_TRUE(marginal);
  for (int i = 0; i < 3; ++i) {
    // A damping of 1e-11 times a condition of 1e3.
    EXPECT_NEAR(marginal->step(i), expected_step(params[i]), 1e-7);
    for (int j = 0; j < 3; ++j) {
      EXPECT_NEAR(
          marginal->covariance(i, j), expected(params[i], params[j]), 1e-7);
    }
  }
}

TEST(ReducedCameraSystem, PointsOfOneRaySayNothing) {
  ReducedCameraSystem system(2);
  LinearizedObservation observation;
  observation.params = {0, 1};
  observation.camera_jacobian = Eigen::Matrix2d::Identity();
  observation.point_jacobian << 1, 0, 0, 0, 1, 0;
  system.AddPoint({observation});
  EXPECT_TRUE(system.Information().isZero(0));
}

TEST(ReducedCameraSystem, RefusesParametersOutOfRange) {
  ReducedCameraSystem system(2);
  EXPECT_THROW(system.AddPrior(2, 1), std::invalid_argument);
  EXPECT_THROW(system.AddPrior(0, 0), std::invalid_argument);
  LinearizedObservation observation;
  observation.params = {5};
  observation.camera_jacobian = Eigen::Vector2d::Ones();
  observation.point_jacobian.setZero();
  EXPECT_THROW(system.AddPoint({observation}), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
