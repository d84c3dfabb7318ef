#include "estimators/averaging/focal_population.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {

namespace {

// Standard deviation of a normal distribution over its median absolute
// deviation.
// Variance of the median of normal values over that of their mean.
constexpr double kMedianVariance = 1.5708;

// What estimates of one camera cannot say about their own spread the others'
// does.
std::vector<double> VariancesOf(
    const std::vector<CameraFocalEstimate>& estimates) {
  std::vector<double> spreads;
  for (const CameraFocalEstimate& estimate : estimates) {
    spreads.push_back(estimate.log_spread);
  }
  const double min_spread = Median(spreads);
  std::vector<double> variances;
  for (const CameraFocalEstimate& estimate : estimates) {
    const double spread = std::max(estimate.log_spread, min_spread);
    variances.push_back(kMedianVariance * spread * spread /
                        estimate.num_estimates);
  }
  return variances;
}

}  // namespace

bool FocalPopulationOptions::IsValid(std::string* error) const {
  return CheckOption(min_num_cameras >= 2,
                     "min_num_cameras must be >= 2",
                     min_num_cameras,
                     error) &&
         CheckOption(min_log_stddev > 0,
                     "min_log_stddev must be > 0",
                     min_log_stddev,
                     error);
}

std::vector<FocalPosterior> ShrinkFocals(
    const FocalPopulationOptions& options,
    const std::vector<CameraFocalEstimate>& estimates) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  std::vector<CameraFocalEstimate> known;
  std::vector<double> values;
  for (const CameraFocalEstimate& estimate : estimates) {
    if (estimate.num_estimates == 0) continue;
    DGSFM_CHECK(std::isfinite(estimate.log_focal_length) &&
                std::isfinite(estimate.log_spread) && estimate.log_spread >= 0);
    known.push_back(estimate);
    values.push_back(estimate.log_focal_length);
  }
  if (known.size() < size_t(options.min_num_cameras)) return {};

  const double mean = Median(values);
  std::vector<double> deviations;
  for (const double value : values)
    deviations.push_back(std::abs(value - mean));
  const double spread = kStddevPerMad * Median(deviations);
  std::vector<double> variances = VariancesOf(known);
  const double population_variance =
      std::max(spread * spread - Median(variances),
               options.min_log_stddev * options.min_log_stddev);

  std::vector<FocalPosterior> posteriors;
  auto variance = variances.begin();
  for (const CameraFocalEstimate& estimate : estimates) {
    if (estimate.num_estimates == 0) {
      posteriors.push_back({mean, std::sqrt(population_variance)});
      continue;
    }
    const double share =
        population_variance / (population_variance + *variance);
    posteriors.push_back({mean + share * (estimate.log_focal_length - mean),
                          std::sqrt(share * *variance)});
    ++variance;
  }
  return posteriors;
}

}  // namespace dgsfm
