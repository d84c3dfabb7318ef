#include "colmap_ext/depth/depth_map_statistics.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace dgsfm {
namespace {

// More values make quantiles no better.
constexpr size_t kMaxNumSamples = 20000;
constexpr double kConstantTolerance = 1e-3;
// Fewer known pixels show nothing.
constexpr size_t kMinNumKnown = 100;

float Quantile(std::vector<float>* values, double share) {
  if (values->empty()) return 0;
  const auto nth =
      values->begin() + static_cast<ptrdiff_t>(share * (values->size() - 1));
  std::nth_element(values->begin(), nth, values->end());
  return *nth;
}

// Known values of the rows, not more than about kMaxNumSamples.
std::vector<float> SampleRows(const DepthMap& map, int begin, int end) {
  const size_t first = size_t(begin) * map.width;
  const size_t last = size_t(end) * map.width;
  const size_t step = std::max<size_t>(1, (last - first) / kMaxNumSamples);
  std::vector<float> values;
  for (size_t i = first; i < last; i += step) {
    if (map.values[i] != 0) values.push_back(map.values[i]);
  }
  return values;
}

double LowerToUpper(const DepthMap& map) {
  std::vector<float> upper = SampleRows(map, 0, map.height / 3);
  std::vector<float> lower =
      SampleRows(map, map.height - map.height / 3, map.height);
  const double upper_median = Quantile(&upper, 0.5);
  const double lower_median = Quantile(&lower, 0.5);
  return upper_median > 0 && lower_median > 0 ? lower_median / upper_median : 1;
}

}  // namespace

DepthMapStatistics MeasureDepthMap(const DepthMap& depth_map) {
  DepthMapStatistics result;
  size_t num_known = 0;
  size_t num_at_max = 0;
  result.are_whole = true;
  for (const float value : depth_map.values) {
    if (value == 0) continue;
    if (num_known == 0 || value > result.max) {
      result.max = value;
      num_at_max = 0;
    }
    result.min = num_known == 0 ? value : std::min<double>(result.min, value);
    num_at_max += value == result.max;
    result.are_whole &= value == std::floor(value);
    ++num_known;
  }
  if (num_known == 0) return {};
  std::vector<float> values = SampleRows(depth_map, 0, depth_map.height);
  result.median = Quantile(&values, 0.5);
  result.lower_to_upper = LowerToUpper(depth_map);
  if (num_known < kMinNumKnown) return result;
  result.share_at_max = double(num_at_max) / double(num_known);
  const double low = Quantile(&values, 0.05);
  const double high = Quantile(&values, 0.95);
  result.is_constant = high - low <= kConstantTolerance * std::abs(high);
  return result;
}

}  // namespace dgsfm
