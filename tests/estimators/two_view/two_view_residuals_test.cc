#include "estimators/two_view/two_view_residuals.h"

#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr double kStep = 1e-6;
// Central differences of smooth functions: about kStep^2 plus rounding / kStep.
constexpr double kTolerance = 1e-6;

struct MatchCase {
  TwoViewModel model;
  Eigen::Vector2d x1, x2;
  double depth1, depth2;
};

MatchCase CreateCase(std::mt19937_64* random) {
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(*random);
  };
  MatchCase match;
  match.model.rotation =
      Eigen::AngleAxisd(
          uniform(0, 0.7),
          Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), 0.3).normalized())
          .toRotationMatrix();
  match.model.translation << uniform(-2, 2), uniform(-2, 2), uniform(-1, 1);
  match.model.scale = uniform(0.5, 2);
  match.model.focal1 = uniform(800, 2000);
  match.model.focal2 = uniform(800, 2000);
  match.x1 << uniform(-500, 500), uniform(-500, 500);
  match.x2 << uniform(-500, 500), uniform(-500, 500);
  match.depth1 = uniform(5, 9);
  match.depth2 = uniform(5, 9);
  return match;
}

// d f(Retract(model, step)) / d step by central differences.
template <typename Function>
Eigen::MatrixXd NumericJacobian(const TwoViewModel& model,
                                const Function& function) {
  const Eigen::VectorXd value = function(model);
  Eigen::MatrixXd jacobian(value.size(), kNumTwoViewParams);
  for (int k = 0; k < kNumTwoViewParams; ++k) {
    const TwoViewStep step = kStep * TwoViewStep::Unit(k);
    jacobian.col(k) =
        (function(Retract(model, step)) - function(Retract(model, -step))) /
        (2 * kStep);
  }
  return jacobian;
}

TEST(TwoViewResiduals, SampsonJacobianMatchesDifferences) {
  const PointCovariance covariance1(1.5, 0.2, 0.7);
  const PointCovariance covariance2(0.8, -0.3, 2);
  std::mt19937_64 random(1);
  for (int k = 0; k < 100; ++k) {
    const MatchCase match = CreateCase(&random);
    const auto residual = [&](const TwoViewModel& model) {
      return Eigen::VectorXd::Constant(1,
                                       SampsonError(model.FundamentalMatrix(),
                                                    match.x1,
                                                    match.x2,
                                                    covariance1,
                                                    covariance2));
    };
    Eigen::Matrix3d gradient;
    const double value = SampsonError(match.model.FundamentalMatrix(),
                                      match.x1,
                                      match.x2,
                                      covariance1,
                                      covariance2,
                                      &gradient);
    EXPECT_EQ(value, residual(match.model)(0));
    const Eigen::MatrixXd jacobian =
        Eigen::Map<Eigen::Matrix<double, 1, 9>>(gradient.data()) *
        FundamentalMatrixJacobian(match.model);
    const Eigen::MatrixXd expected = NumericJacobian(match.model, residual);
    EXPECT_LT((jacobian - expected).norm(), kTolerance * expected.norm());
  }
}

bool TransferCase(const TwoViewModel& model,
                  const MatchCase& match,
                  Transfer* transfer) {
  return TransferMatch(
      model, match.x1, match.depth1, match.x2, match.depth2, transfer);
}

TEST(TwoViewResiduals, TransferGradientMatchesDifferences) {
  std::mt19937_64 random(2);
  const Eigen::Vector2d pixel_weights(0.3, -0.8);
  constexpr double kLogDepthWeight = 50;
  for (int k = 0; k < 100; ++k) {
    const MatchCase match = CreateCase(&random);
    const auto residual = [&](const TwoViewModel& model) {
      Transfer transfer;
      EXPECT_TRUE(TransferCase(model, match, &transfer));
      return Eigen::VectorXd::Constant(
          1,
          pixel_weights.dot(transfer.error_px) +
              kLogDepthWeight * transfer.log_depth_ratio);
    };
    Transfer transfer;
    ASSERT_TRUE(TransferCase(match.model, match, &transfer));
    const TwoViewStep gradient =
        TransferGradient(match.model, transfer, pixel_weights, kLogDepthWeight);
    const Eigen::MatrixXd expected = NumericJacobian(match.model, residual);
    EXPECT_LT((gradient.transpose() - expected).norm(),
              kTolerance * expected.norm());
  }
}

// The transfer from view 2 to 1, by the parameters of the model.
TEST(TwoViewResiduals, InverseJacobianMatchesDifferences) {
  std::mt19937_64 random(3);
  const Eigen::Vector2d pixel_weights(0.3, -0.8);
  constexpr double kLogDepthWeight = 50;
  for (int k = 0; k < 100; ++k) {
    const MatchCase match = CreateCase(&random);
    const auto transfer_back = [&](const TwoViewModel& model) {
      Transfer transfer;
      EXPECT_TRUE(TransferMatch(model.Inverse(),
                                match.x2,
                                match.depth2,
                                match.x1,
                                match.depth1,
                                &transfer));
      return transfer;
    };
    const auto residual = [&](const TwoViewModel& model) {
      const Transfer transfer = transfer_back(model);
      return Eigen::VectorXd::Constant(
          1,
          pixel_weights.dot(transfer.error_px) +
              kLogDepthWeight * transfer.log_depth_ratio);
    };
    const TwoViewStep gradient = InverseJacobian(match.model).transpose() *
                                 TransferGradient(match.model.Inverse(),
                                                  transfer_back(match.model),
                                                  pixel_weights,
                                                  kLogDepthWeight);
    const Eigen::MatrixXd expected = NumericJacobian(match.model, residual);
    EXPECT_LT((gradient.transpose() - expected).norm(),
              kTolerance * expected.norm());
  }
}

TEST(TwoViewResiduals, PointBehindCameraIsRefused) {
  TwoViewModel model;
  model.translation.z() = -2;
  Transfer transfer;
  EXPECT_FALSE(TransferMatch(model,
                             {0, 0},
                             /*depth1=*/1,
                             {0, 0},
                             /*depth2=*/1,
                             &transfer));
}

}  // namespace
}  // namespace dgsfm
