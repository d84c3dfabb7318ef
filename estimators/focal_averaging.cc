#include "estimators/focal_averaging.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

struct WeightedValue {
  double value;
  double weight;
};

// Value below and above which half of the weight lies; the mean of two where
// any value between them does. Values must not be empty.
double WeightedMedian(std::vector<WeightedValue> values) {
  std::sort(values.begin(), values.end(), [](const auto& a, const auto& b) {
    return a.value < b.value;
  });
  double total = 0;
  for (const WeightedValue& value : values) total += value.weight;
  double sum = 0;
  for (size_t i = 0; i + 1 < values.size(); ++i) {
    sum += values[i].weight;
    if (2 * sum > total) return values[i].value;
    if (2 * sum == total) return (values[i].value + values[i + 1].value) / 2;
  }
  return values.back().value;
}

}  // namespace

std::optional<AveragedFocal> AverageFocals(
    const std::vector<FocalEstimate>& estimates) {
  if (estimates.empty()) return std::nullopt;
  std::vector<WeightedValue> values;
  for (const FocalEstimate& estimate : estimates) {
    DGSFM_CHECK(std::isfinite(estimate.focal_length_px) &&
                estimate.focal_length_px > 0)
        << "focal length = " << estimate.focal_length_px;
    DGSFM_CHECK(std::isfinite(estimate.weight) && estimate.weight > 0)
        << "weight = " << estimate.weight;
    values.push_back({std::log(estimate.focal_length_px), estimate.weight});
  }
  const double median = WeightedMedian(values);
  for (WeightedValue& value : values) {
    value.value = std::abs(value.value - median);
  }
  // 1.4826 makes it the standard deviation of normally distributed values.
  return AveragedFocal{std::exp(median), 1.4826 * WeightedMedian(values)};
}

}  // namespace dgsfm
