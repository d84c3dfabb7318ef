#include "colmap_ext/depth/affine_depth.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dgsfm {
namespace {

// Difference of neighbours beyond which they are of two surfaces [range of the
// map]: five levels of a map of 8 bits.
constexpr double kMaxNeighborDifference = 0.02;

struct Range {
  float min = std::numeric_limits<float>::max();
  float max = std::numeric_limits<float>::lowest();
};

Range RangeOf(const std::vector<float>& values) {
  Range range;
  for (const float value : values) {
    if (value == 0) continue;
    range.min = std::min(range.min, value);
    range.max = std::max(range.max, value);
  }
  return range;
}

float SampleAt(const DepthMap& depth_map,
               double x,
               double y,
               double max_difference,
               bool keep_edges) {
  const double center_x = std::clamp(x - 0.5, 0.0, depth_map.width - 1.0);
  const double center_y = std::clamp(y - 0.5, 0.0, depth_map.height - 1.0);
  const int x0 = static_cast<int>(center_x);
  const int y0 = static_cast<int>(center_y);
  double sum = 0;
  double sum_weights = 0;
  double nearest_weight = 0;
  float nearest = 0;
  Range range;
  for (int i = 0; i < 4; ++i) {
    const int dx = i & 1;
    const int dy = i >> 1;
    const float value = depth_map.At(std::min(x0 + dx, depth_map.width - 1),
                                     std::min(y0 + dy, depth_map.height - 1));
    const double weight_x = dx == 1 ? center_x - x0 : 1 - (center_x - x0);
    const double weight_y = dy == 1 ? center_y - y0 : 1 - (center_y - y0);
    const double weight = weight_x * weight_y;
    if (value == 0 || weight <= 0) continue;
    sum += weight * value;
    sum_weights += weight;
    range.min = std::min(range.min, value);
    range.max = std::max(range.max, value);
    if (weight > nearest_weight) {
      nearest_weight = weight;
      nearest = value;
    }
  }
  if (sum_weights <= 0) return 0;
  if (range.max - range.min > max_difference) return keep_edges ? nearest : 0;
  return static_cast<float>(sum / sum_weights);
}

}  // namespace

bool IsAffine(DepthUnit unit) {
  return unit == DepthUnit::AFFINE_DISPARITY || unit == DepthUnit::AFFINE_DEPTH;
}

float ConvertAffine(const AffineDepth& affine, float value) {
  if (value == 0) return 0;
  const double difference = value - affine.shift;
  if (!(difference > std::max(affine.min_difference, 0.0))) return 0;
  const auto depth = static_cast<float>(
      affine.unit == DepthUnit::AFFINE_DISPARITY ? affine.scale / difference
                                                 : difference / affine.scale);
  return std::isfinite(depth) ? depth : 0;
}

void ConvertAffine(const AffineDepth& affine, KeypointDepths* depths) {
  for (float& value : depths->depths) value = ConvertAffine(affine, value);
  depths->unit = DepthUnit::RELATIVE;
}

void ConvertAffine(const AffineDepth& affine, DepthMap* depth_map) {
  for (float& value : depth_map->values) value = ConvertAffine(affine, value);
  depth_map->unit = DepthUnit::RELATIVE;
}

std::vector<float> SampleAffine(const DepthMap& depth_map,
                                const std::vector<Eigen::Vector2d>& points,
                                int image_width,
                                int image_height,
                                bool keep_edges) {
  const Range range = RangeOf(depth_map.values);
  const double max_difference =
      kMaxNeighborDifference * (double(range.max) - double(range.min));
  std::vector<float> samples;
  samples.reserve(points.size());
  for (const Eigen::Vector2d& point : points) {
    // Written so that NaN is outside.
    const bool is_inside = point.x() >= 0 && point.x() <= image_width &&
                           point.y() >= 0 && point.y() <= image_height;
    samples.push_back(
        is_inside ? SampleAt(depth_map,
                             point.x() * depth_map.width / image_width,
                             point.y() * depth_map.height / image_height,
                             max_difference,
                             keep_edges)
                  : 0);
  }
  return samples;
}

DepthMap StorableAffine(DepthMap depth_map) {
  constexpr double kLowest = 1;
  constexpr double kHighest = 32768;
  DGSFM_CHECK(IsAffine(depth_map.unit));
  const Range range = RangeOf(depth_map.values);
  if (range.min >= kMinStorableDepth && range.max <= kMaxStorableDepth) {
    return depth_map;
  }
  const double spread = std::max(double(range.max) - double(range.min), 1e-30);
  for (float& value : depth_map.values) {
    if (value == 0) continue;
    value = static_cast<float>(kLowest + (kHighest - kLowest) *
                                             ((value - range.min) / spread));
  }
  return depth_map;
}

}  // namespace dgsfm
