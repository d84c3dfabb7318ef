#include "estimators/affine_depth_fit.h"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;
using Samples = std::vector<AffineDepthSample>;

constexpr double kScale = 150;
constexpr double kShift = 20;

// Places at depths of 2 to 10 whose values are kScale / z + kShift with
// relative errors of the first part, in units of a pair of its own.
Samples CreatePair(double unit,
                   double noise,
                   double share_of_outliers,
                   int num_samples,
                   std::mt19937* random) {
  std::uniform_real_distribution<double> depth(2, 10);
  std::uniform_real_distribution<double> share(0, 1);
  std::normal_distribution<double> error(0, noise);
  Samples samples;
  for (int i = 0; i < num_samples; ++i) {
    const double inverse = 1 / depth(*random);
    const bool is_outlier = share(*random) < share_of_outliers;
    const double value =
        is_outlier ? kShift + 100 * share(*random)
                   : kShift + kScale * inverse * std::exp(error(*random));
    samples.push_back({value, unit * inverse});
  }
  return samples;
}

std::vector<Samples> CreatePairs(double noise, double share_of_outliers) {
  std::mt19937 random(1);
  std::vector<Samples> pairs;
  for (const double unit : {0.5, 1.0, 3.0}) {
    pairs.push_back(CreatePair(unit, noise, share_of_outliers, 200, &random));
  }
  return pairs;
}

TEST(AffineDepthFit, FindsTheShiftOfPairsOfAnyUnit) {
  const AffineDepthFit fit = FitAffineDepth(CreatePairs(0, 0), {});
  ASSERT_TRUE(fit.success) << fit.reason;
  EXPECT_NEAR(fit.shift, kShift, 0.05);
  EXPECT_NEAR(fit.scales[0], kScale / 0.5, 1);
  EXPECT_NEAR(fit.scales[2], kScale / 3, 0.2);
  EXPECT_EQ(fit.num_pairs, 3);
  EXPECT_EQ(fit.num_samples, 600);
  EXPECT_EQ(fit.concordance, 1);
}

TEST(AffineDepthFit, BearsNoiseAndOutliers) {
  const AffineDepthFit fit = FitAffineDepth(CreatePairs(0.05, 0.2), {});
  ASSERT_TRUE(fit.success) << fit.reason;
  EXPECT_NEAR(fit.shift, kShift, 3 * fit.shift_stddev);
  EXPECT_NEAR(fit.shift, kShift, 3);
  EXPECT_LT(fit.noise, 0.1);
}

TEST(AffineDepthFit, OnePairOfAnotherGeometryChangesLittle) {
  std::vector<Samples> pairs = CreatePairs(0.02, 0);
  Samples bent = pairs[1];
  for (AffineDepthSample& sample : bent) sample.predictor += 0.1;
  pairs.push_back(bent);
  const AffineDepthFit fit = FitAffineDepth(pairs, {});
  ASSERT_TRUE(fit.success) << fit.reason;
  EXPECT_NEAR(fit.shift, kShift, 3 * fit.shift_stddev);
  EXPECT_NEAR(fit.shift, kShift, 5);
}

TEST(AffineDepthFit, RefusesValuesOfTheOtherKind) {
  std::vector<Samples> pairs = CreatePairs(0.02, 0);
  for (Samples& samples : pairs) {
    for (AffineDepthSample& sample : samples) {
      sample.predictor = 1 / sample.predictor;
    }
  }
  const AffineDepthFit fit = FitAffineDepth(pairs, {});
  EXPECT_FALSE(fit.success);
  EXPECT_LT(fit.concordance, -0.9);
  EXPECT_THAT(fit.reason, HasSubstr("unrelated"));
}

TEST(AffineDepthFit, RefusesUnrelatedAndConstantValues) {
  std::vector<Samples> pairs = CreatePairs(0.02, 0);
  std::vector<Samples> constant = pairs;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> value(0, 255);
  for (size_t p = 0; p < pairs.size(); ++p) {
    for (size_t i = 0; i < pairs[p].size(); ++i) {
      pairs[p][i].value = value(random);
      constant[p][i].value = 7;
    }
  }
  EXPECT_FALSE(FitAffineDepth(pairs, {}).success);
  EXPECT_THAT(FitAffineDepth(constant, {}).reason, HasSubstr("the same"));
}

TEST(AffineDepthFit, NeedsEnoughPlaces) {
  std::mt19937 random(1);
  EXPECT_FALSE(FitAffineDepth({CreatePair(1, 0, 0, 10, &random)}, {}).success);
  EXPECT_FALSE(FitAffineDepth({}, {}).success);
}

TEST(AffineDepthFit, RefusesInvalidNumbers) {
  EXPECT_THROW(FitAffineDepth({{{1, -1}}}, {}), std::invalid_argument);
  EXPECT_THROW(FitAffineDepth({{{NAN, 1}}}, {}), std::invalid_argument);
}

TEST(Concordance, IsThatOfRanks) {
  EXPECT_EQ(Concordance({{1, 1}, {2, 2}, {3, 3}, {10, 4}}), 1);
  EXPECT_EQ(Concordance({{4, 1}, {3, 2}, {2, 3}, {1, 4}}), -1);
  EXPECT_EQ(Concordance({{1, 1}}), 0);
}

}  // namespace
}  // namespace dgsfm
