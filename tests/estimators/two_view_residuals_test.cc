#include "estimators/two_view_residuals.h"

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
  std::mt19937_64 random(1);
  for (int k = 0; k < 100; ++k) {
    const MatchCase match = CreateCase(&random);
    const auto residual = [&](const TwoViewModel& model) {
      return Eigen::VectorXd::Constant(
          1, SampsonError(model.FundamentalMatrix(), match.x1, match.x2));
    };
    Eigen::Matrix3d gradient;
    const double value = SampsonError(
        match.model.FundamentalMatrix(), match.x1, match.x2, &gradient);
    EXPECT_EQ(value, residual(match.model)(0));
    const Eigen::MatrixXd jacobian =
        Eigen::Map<Eigen::Matrix<double, 1, 9>>(gradient.data()) *
        FundamentalMatrixJacobian(match.model);
    const Eigen::MatrixXd expected = NumericJacobian(match.model, residual);
    EXPECT_LT((jacobian - expected).norm(), kTolerance * expected.norm());
  }
}

template <typename TransferFunction>
void ExpectTransferJacobian(const TransferFunction& transfer_match) {
  std::mt19937_64 random(2);
  for (int k = 0; k < 100; ++k) {
    const MatchCase match = CreateCase(&random);
    const auto residual = [&](const TwoViewModel& model) {
      Transfer transfer;
      EXPECT_TRUE(transfer_match(model,
                                 match.x1,
                                 match.depth1,
                                 match.x2,
                                 match.depth2,
                                 &transfer,
                                 nullptr));
      Eigen::VectorXd value(3);
      value << transfer.error_px, transfer.log_depth_ratio;
      return value;
    };
    Transfer transfer;
    TransferJacobian jacobian;
    ASSERT_TRUE(transfer_match(match.model,
                               match.x1,
                               match.depth1,
                               match.x2,
                               match.depth2,
                               &transfer,
                               &jacobian));
    const Eigen::MatrixXd expected = NumericJacobian(match.model, residual);
    for (int row = 0; row < 3; ++row) {
      EXPECT_LT((jacobian.row(row) - expected.row(row)).norm(),
                kTolerance * expected.row(row).norm());
    }
  }
}

TEST(TwoViewResiduals, ForwardJacobianMatchesDifferences) {
  ExpectTransferJacobian(TransferForward);
}

TEST(TwoViewResiduals, BackwardJacobianMatchesDifferences) {
  ExpectTransferJacobian(TransferBackward);
}

TEST(TwoViewResiduals, BackwardIsForwardOfSwappedViews) {
  std::mt19937_64 random(3);
  const MatchCase match = CreateCase(&random);
  Transfer backward, forward;
  ASSERT_TRUE(TransferBackward(
      match.model, match.x1, match.depth1, match.x2, match.depth2, &backward));
  ASSERT_TRUE(TransferForward(match.model.Inverse(),
                              match.x2,
                              match.depth2,
                              match.x1,
                              match.depth1,
                              &forward));
  // The same arithmetic in another order, on errors of up to 1e3 px.
  EXPECT_LT((backward.error_px - forward.error_px).norm(), 1e-9);
  EXPECT_NEAR(backward.log_depth_ratio, forward.log_depth_ratio, 1e-12);
}

TEST(TwoViewResiduals, PointBehindCameraIsRefused) {
  TwoViewModel model;
  model.translation.z() = -2;
  Transfer transfer;
  EXPECT_FALSE(TransferForward(
      model, {0, 0}, /*depth1=*/1, {0, 0}, /*depth2=*/1, &transfer));
}

}  // namespace
}  // namespace dgsfm
