#include "estimators/averaging/focal_population.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {

namespace {

// Variance of the median of normal values over that of their mean.
constexpr double kMedianVariance = 1.5708;
// Cameras with estimates that a population needs.
constexpr size_t kMinNumCameras = 4;
// Smallest spread of log focal lengths over a population [1].
constexpr double kMinLogStddev = 0.005;

}  // namespace

std::vector<double> ShrinkLogFocals(
    const std::vector<CameraFocalEstimate>& estimates) {
  std::vector<double> values, spreads;
  for (const CameraFocalEstimate& estimate : estimates) {
    if (estimate.num_estimates == 0) continue;
    DGSFM_CHECK(std::isfinite(estimate.log_focal_length) &&
                std::isfinite(estimate.log_spread) && estimate.log_spread >= 0);
    values.push_back(estimate.log_focal_length);
    spreads.push_back(estimate.log_spread);
  }
  if (values.size() < kMinNumCameras) return {};

  const double median = Median(values);
  const double population_spread = RobustStddev(values, median);
  // The spread of few estimates may be small by chance.
  const double min_spread = Median(spreads);
  const auto variance_of = [&](const CameraFocalEstimate& estimate) {
    const double spread = std::max(estimate.log_spread, min_spread);
    return kMedianVariance * spread * spread / estimate.num_estimates;
  };
  std::vector<double> variances;
  for (const CameraFocalEstimate& estimate : estimates) {
    if (estimate.num_estimates > 0) variances.push_back(variance_of(estimate));
  }
  const double population_variance =
      std::max(population_spread * population_spread - Median(variances),
               kMinLogStddev * kMinLogStddev);

  std::vector<double> shrunk;
  for (const CameraFocalEstimate& estimate : estimates) {
    if (estimate.num_estimates == 0) {
      shrunk.push_back(median);
      continue;
    }
    const double share =
        population_variance / (population_variance + variance_of(estimate));
    shrunk.push_back(median + share * (estimate.log_focal_length - median));
  }
  return shrunk;
}

}  // namespace dgsfm
