#include "estimators/two_view/two_view_residuals.h"

#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr double kStep = 1e-6;
// Central differences of smooth functions: about kStep^2 plus rounding / kStep.
constexpr double kTolerance = 1e-6;

TwoViewModel CreateModel(std::mt19937_64* random) {
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(*random);
  };
  TwoViewModel model;
  model.rotation =
      Eigen::AngleAxisd(
          uniform(0, 0.7),
          Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), 0.3).normalized())
          .toRotationMatrix();
  model.translation << uniform(-2, 2), uniform(-2, 2), uniform(-1, 1);
  model.scale = uniform(0.5, 2);
  model.focal1 = uniform(800, 2000);
  model.focal2 = uniform(800, 2000);
  return model;
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

TEST(TwoViewResiduals, FundamentalMatrixJacobianMatchesDifferences) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 100; ++k) {
    const TwoViewModel model = CreateModel(&random);
    const Eigen::MatrixXd expected = NumericJacobian(
        model, [](const TwoViewModel& moved) -> Eigen::VectorXd {
          return moved.FundamentalMatrix().reshaped();
        });
    EXPECT_LT((FundamentalMatrixJacobian(model) - expected).norm(),
              kTolerance * expected.norm());
  }
}

// Rotation, translation and logarithms of the inverse of a moved model, as
// steps from the inverse of the model.
TEST(TwoViewResiduals, InverseJacobianMatchesDifferences) {
  std::mt19937_64 random(3);
  for (int k = 0; k < 100; ++k) {
    const TwoViewModel model = CreateModel(&random);
    const TwoViewModel inverse = model.Inverse();
    const auto step_to = [&inverse](const TwoViewModel& moved) {
      const TwoViewModel moved_inverse = moved.Inverse();
      const Eigen::AngleAxisd rotation(moved_inverse.rotation *
                                       inverse.rotation.transpose());
      Eigen::VectorXd step(kNumTwoViewParams);
      step << rotation.angle() * rotation.axis(),
          moved_inverse.translation - inverse.translation,
          std::log(moved_inverse.scale / inverse.scale),
          std::log(moved_inverse.focal1 / inverse.focal1),
          std::log(moved_inverse.focal2 / inverse.focal2);
      return step;
    };
    const Eigen::MatrixXd expected = NumericJacobian(model, step_to);
    EXPECT_LT((InverseJacobian(model) - expected).norm(),
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
