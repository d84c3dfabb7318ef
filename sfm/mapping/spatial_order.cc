#include "sfm/mapping/spatial_order.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

namespace dgsfm {

namespace {

// Bits of a coordinate: three fit into a key.
constexpr int kNumBits = 20;
// Share of the positions on either side that may be outside of the cube.
constexpr double kOutsideShare = 0.01;

}  // namespace

std::vector<size_t> OrderAlongCurve(
    const std::vector<Eigen::Vector3d>& positions) {
  const size_t count = positions.size();
  std::vector<size_t> order(count);
  std::iota(order.begin(), order.end(), size_t(0));
  if (count == 0) return order;
  const auto num_outside = size_t(kOutsideShare * double(count));
  Eigen::Vector3d low;
  double size = 0;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> coordinates;
    for (const auto& position : positions) {
      coordinates.push_back(position(axis));
    }
    std::sort(coordinates.begin(), coordinates.end());
    low(axis) = coordinates[num_outside];
    size = std::max(size, coordinates[count - 1 - num_outside] - low(axis));
  }
  if (!(size > 0)) return order;
  const double max_coordinate = (1 << kNumBits) - 1;
  std::vector<uint64_t> keys(count, 0);
  for (size_t i = 0; i < count; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const double share = (positions[i](axis) - low(axis)) / size;
      const auto coordinate =
          uint64_t(std::clamp(share, 0.0, 1.0) * max_coordinate);
      for (int bit = 0; bit < kNumBits; ++bit) {
        keys[i] |= (coordinate >> bit & 1) << (3 * bit + axis);
      }
    }
  }
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return keys[a] < keys[b];
  });
  return order;
}

}  // namespace dgsfm
