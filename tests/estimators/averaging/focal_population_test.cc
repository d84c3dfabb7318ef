#include "estimators/averaging/focal_population.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kNumEstimates = 9;
constexpr double kSpread = 0.06;

// Medians of estimates that spread by kSpread about true log focal lengths of
// this standard deviation.
std::vector<CameraFocalEstimate> CreateEstimates(double population_stddev,
                                                 std::vector<double>* truth) {
  std::mt19937 generator(5);
  std::normal_distribution<double> normal;
  std::vector<CameraFocalEstimate> estimates;
  for (int i = 0; i < 40; ++i) {
    truth->push_back(7 + population_stddev * normal(generator));
    const double stddev_of_median = std::sqrt(1.5708 / kNumEstimates) * kSpread;
    estimates.push_back({truth->back() + stddev_of_median * normal(generator),
                         kSpread,
                         kNumEstimates});
  }
  return estimates;
}

double RmsError(const std::vector<double>& values,
                const std::vector<double>& truth) {
  double sum = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    sum += (values[i] - truth[i]) * (values[i] - truth[i]);
  }
  return std::sqrt(sum / double(truth.size()));
}

TEST(ShrinkLogFocals, NeverLosesAndGainsMostWhereCamerasAreTheSame) {
  struct Case {
    double population_stddev;
    double max_error_ratio;
  };
  // One camera: the errors of 40 average out, but for the smallest spread.
  // Spread as their errors: half of the variance. Far apart: nothing to gain,
  // nor more to lose than errors of 40 cameras may happen to look like.
  for (const Case& c : {Case{0.0, 0.35}, {0.025, 0.9}, {0.4, 1.05}}) {
    std::vector<double> truth, before, after;
    const auto estimates = CreateEstimates(c.population_stddev, &truth);
    const auto shrunk = ShrinkLogFocals(estimates);
    ASSERT_EQ(shrunk.size(), estimates.size());
    for (size_t i = 0; i < estimates.size(); ++i) {
      before.push_back(estimates[i].log_focal_length);
      after.push_back(shrunk[i]);
    }
    EXPECT_LT(RmsError(after, truth),
              c.max_error_ratio * RmsError(before, truth));
  }
}

TEST(ShrinkLogFocals, CamerasWithoutEstimatesGetTheMedian) {
  std::vector<double> truth;
  auto estimates = CreateEstimates(0.1, &truth);
  estimates.push_back({std::numeric_limits<double>::quiet_NaN(), 0, 0});
  // Three standard deviations of the median of 40.
  EXPECT_NEAR(ShrinkLogFocals(estimates).back(), 7, 0.06);
}

TEST(ShrinkLogFocals, FewCamerasTellNothing) {
  const std::vector<CameraFocalEstimate> estimates(3, {7, 0.1, 5});
  EXPECT_TRUE(ShrinkLogFocals(estimates).empty());
  EXPECT_TRUE(ShrinkLogFocals({}).empty());
}

TEST(ShrinkLogFocals, RefusesWhatIsNotFinite) {
  const std::vector<CameraFocalEstimate> estimates(
      5, {std::numeric_limits<double>::infinity(), 0.1, 5});
  EXPECT_THROW(ShrinkLogFocals(estimates), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
