#include "estimators/focal_averaging.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Logarithms and back: a few roundings.
constexpr double kRelativeRounding = 1e-14;

TEST(AverageFocals, NothingFromNoEstimates) {
  EXPECT_FALSE(AverageFocals({}).has_value());
}

TEST(AverageFocals, SingleEstimateHasNoSpread) {
  const auto focal = AverageFocals({{700, 0.3}});
  EXPECT_NEAR(focal->focal_length_px, 700, 700 * kRelativeRounding);
  EXPECT_EQ(focal->log_spread, 0);
}

TEST(AverageFocals, OddCountGivesTheMiddle) {
  const auto focal = AverageFocals({{1e6}, {500}, {1000}});
  EXPECT_NEAR(focal->focal_length_px, 1000, 1000 * kRelativeRounding);
  EXPECT_NEAR(focal->log_spread, 1.4826 * std::log(2), 1e-12);
}

TEST(AverageFocals, EvenCountGivesTheGeometricMean) {
  EXPECT_NEAR(AverageFocals({{1600}, {1}, {400}, {1e5}})->focal_length_px,
              800,
              800 * kRelativeRounding);
}

TEST(AverageFocals, WeightsCountLikeCopies) {
  const auto weighted = AverageFocals({{300, 2}, {500, 4}, {800, 1}, {900, 3}});
  const auto copied = AverageFocals(
      {{300}, {300}, {500}, {500}, {500}, {500}, {800}, {900}, {900}, {900}});
  EXPECT_EQ(weighted->focal_length_px, copied->focal_length_px);
  EXPECT_EQ(weighted->log_spread, copied->log_spread);
}

TEST(AverageFocals, SpreadIsTheStandardDeviationOfNormalNoise) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::vector<FocalEstimate> estimates;
  for (int i = 0; i < 10000; ++i) {
    estimates.push_back({1000 * std::exp(0.1 * normal(random))});
  }
  const auto focal = AverageFocals(estimates);
  // Standard errors of median and MAD of 10000 values: 1.3 % and 1.2 % of
  // the deviation; three of them.
  EXPECT_NEAR(std::log(focal->focal_length_px / 1000), 0, 0.004);
  EXPECT_NEAR(focal->log_spread, 0.1, 0.004);
}

TEST(AverageFocals, ThrowsOnBrokenEstimates) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double focal : {0.0, -1.0, nan, 1 / 0.0}) {
    EXPECT_THROW(AverageFocals({{focal}}), std::invalid_argument);
    EXPECT_THROW(AverageFocals({{1000, focal}}), std::invalid_argument);
  }
}

}  // namespace
}  // namespace dgsfm
