#include "estimators/two_view/two_view_cost.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// 21 matches leave lanes without a match.
constexpr int kNumMatches = 21;
constexpr double kFocal1Px = 1100;
constexpr double kFocal2Px = 900;

TwoViewModel TrueModel() {
  TwoViewModel model;
  model.rotation =
      Eigen::AngleAxisd(0.3, Eigen::Vector3d(0.2, 1, -0.1).normalized())
          .toRotationMatrix();
  model.translation << -1.5, 0.2, 0.4;
  model.scale = 1.3;
  model.focal1 = kFocal1Px;
  model.focal2 = kFocal2Px;
  return model;
}

// Matches with noise of about a pixel and 10 % of depth; the depths of every
// fifth are unknown.
TwoViewData CreateMatches() {
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise;
  std::uniform_real_distribution<double> uniform(-400, 400);
  const TwoViewModel model = TrueModel();
  TwoViewData data(kNumMatches);
  for (int i = 0; i < kNumMatches; ++i) {
    TwoViewMatch& match = data[i];
    match.x1 << uniform(random), uniform(random);
    match.depth1 = 6 + uniform(random) / 200;
    const Eigen::Vector3d point =
        model.rotation * (match.depth1 * (match.x1 / kFocal1Px).homogeneous()) +
        model.translation;
    match.x2 = kFocal2Px * point.hnormalized() +
               Eigen::Vector2d(noise(random), noise(random));
    match.depth2 = point.z() / model.scale * std::exp(0.1 * noise(random));
    match.covariance1 << 1.5, 0.2, 0.7;
    match.covariance2 << 0.8, -0.3, 2;
    if (i % 5 == 0) match.depth1 = match.depth2 = 0;
  }
  return data;
}

TwoViewCostOptions CreateOptions(DepthTerm depth_term,
                                 TwoViewLoss loss,
                                 bool has_fields) {
  TwoViewCostOptions options;
  options.depth_term = depth_term;
  options.loss = loss;
  options.stddev_px = 1;
  options.max_epipolar_error_px = 20;
  options.max_reprojection_error_px = 400;
  options.max_depth_residual = 20;
  options.focal_prior1 = {1000, 0.2};
  if (has_fields) options.depth_field_stddev = 0.3;
  options.depth_field_unit1_px = 500;
  options.depth_field_unit2_px = 400;
  return options;
}

double Square(double x) { return x * x; }

TEST(TwoViewCost, SumsTheResidualsOfTheMatches) {
  const TwoViewData data = CreateMatches();
  const TwoViewModel model = TrueModel();
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  TwoViewCostOptions options = CreateOptions(
      DepthTerm::REPROJECTION, TwoViewLoss::TRUNCATED_SQUARES, false);
  options.max_epipolar_error_px = 1;
  options.max_reprojection_error_px = 30;
  double epipolar = 0, depth = 0;
  int num_depth_inliers = 0;
  for (const TwoViewMatch& match : data) {
    epipolar += std::min(Square(match.Sampson(F)), 1.0);
    if (!match.HasDepths()) continue;
    for (const bool forward : {true, false}) {
      Transfer transfer;
      ASSERT_TRUE((forward ? match : match.Swapped())
                      .Forward(forward ? model : model.Inverse(), &transfer));
      const double sq_error = transfer.error_px.squaredNorm() / Square(30);
      depth += std::min(sq_error, 1.0);
      num_depth_inliers += sq_error < 1;
    }
  }
  // Both kinds occur.
  ASSERT_LT(num_depth_inliers, 2 * 16);
  ASSERT_GT(num_depth_inliers, 0);
  const TwoViewCost cost =
      TwoViewCostFunction(data, options).Evaluate(model, DepthFields::Zero());
  // Sums in another order.
  EXPECT_NEAR(cost.epipolar, epipolar, 1e-12 * epipolar);
  EXPECT_NEAR(cost.depth, depth, 1e-12 * depth);
  EXPECT_EQ(cost.num_depth_inliers, num_depth_inliers);
}

TEST(TwoViewCost, PointsBehindTheCameraCostTheTruncation) {
  TwoViewData data(1);
  data[0].depth1 = data[0].depth2 = 1;
  TwoViewModel model;
  model.translation.z() = -2;
  const TwoViewCostOptions options =
      CreateOptions(DepthTerm::WHITENED, TwoViewLoss::TRUNCATED_SQUARES, false);
  const TwoViewCost cost =
      TwoViewCostFunction(data, options).EvaluateDepth(model);
  EXPECT_EQ(cost.depth, Square(options.max_depth_residual));
  EXPECT_EQ(cost.num_depth_inliers, 0);
}

struct CostCase {
  DepthTerm depth_term;
  TwoViewLoss loss;
  bool has_fields;
  const char* name;
};

class TwoViewCostDerivatives : public testing::TestWithParam<CostCase> {};

// The gradient of a robust cost is twice that of the normal equations, under
// every loss.
TEST_P(TwoViewCostDerivatives, MatchDifferencesOfTheCost) {
  const CostCase& param = GetParam();
  const TwoViewData data = CreateMatches();
  const TwoViewCostOptions options =
      CreateOptions(param.depth_term, param.loss, param.has_fields);
  const TwoViewModel model = TrueModel();
  DepthFields fields = DepthFields::Zero();
  if (param.has_fields) fields.setLinSpaced(-0.1, 0.1);
  TwoViewCostFunction function(data, options);
  NormalEquations normal;
  const TwoViewCost cost = function.Linearize(model, fields, &normal);
  // The whitening of the linearisation is kept.
  const TwoViewCost again = function.Evaluate(model, fields);
  EXPECT_NEAR(again.Total(), cost.Total(), 1e-12 * cost.Total());
  EXPECT_EQ(again.num_depth_inliers, cost.num_depth_inliers);
  constexpr double kStep = 1e-6;
  const int num_params =
      param.has_fields ? kNumCostParams : static_cast<int>(kNumTwoViewParams);
  for (int k = 0; k < num_params; ++k) {
    const auto cost_at = [&](double step) {
      if (k < kNumTwoViewParams) {
        return function
            .Evaluate(Retract(model, step * TwoViewStep::Unit(k)), fields)
            .Total();
      }
      DepthFields moved = fields;
      moved(k - kNumTwoViewParams) += step;
      return function.Evaluate(model, moved).Total();
    };
    const double expected = (cost_at(kStep) - cost_at(-kStep)) / (2 * kStep);
    // Central differences: about kStep^2 plus rounding of the cost / kStep.
    EXPECT_NEAR(2 * normal.gradient(k),
                expected,
                1e-6 * std::abs(expected) + 1e-8 * cost.Total())
        << "parameter " << k;
  }
}

INSTANTIATE_TEST_SUITE_P(
    TwoViewCost,
    TwoViewCostDerivatives,
    testing::Values(CostCase{DepthTerm::NONE,
                             TwoViewLoss::TRUNCATED_SQUARES,
                             false,
                             "WithoutDepth"},
                    CostCase{DepthTerm::WHITENED,
                             TwoViewLoss::TRUNCATED_SQUARES,
                             false,
                             "Whitened"},
                    CostCase{DepthTerm::WHITENED,
                             TwoViewLoss::TRUNCATED_CAUCHY,
                             true,
                             "WhitenedWithFields"},
                    CostCase{DepthTerm::REPROJECTION,
                             TwoViewLoss::CAUCHY,
                             false,
                             "Reprojection"}),
    [](const testing::TestParamInfo<CostCase>& test) {
      return test.param.name;
    });

}  // namespace
}  // namespace dgsfm
