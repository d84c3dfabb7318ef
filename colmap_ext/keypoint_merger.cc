#include "colmap_ext/keypoint_merger.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dgsfm {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
// Cells of no merging at all would be without size.
constexpr double kMinCellSize = 0.01;

}  // namespace

KeypointMerger::KeypointMerger(double radius_px)
    : radius_px_(radius_px), cell_size_px_(std::max(kMinCellSize, radius_px)) {
  DGSFM_CHECK(radius_px >= 0 && std::isfinite(radius_px)) << radius_px;
}

uint64_t KeypointMerger::CellKey(int64_t x, int64_t y) {
  return (static_cast<uint64_t>(x) << 32) ^ static_cast<uint32_t>(y);
}

uint32_t KeypointMerger::FindNearest(const Eigen::Vector2f& point) const {
  const auto cell_x =
      static_cast<int64_t>(std::floor(point.x() / cell_size_px_));
  const auto cell_y =
      static_cast<int64_t>(std::floor(point.y() / cell_size_px_));
  uint32_t nearest = kNone;
  double nearest_distance = std::numeric_limits<double>::max();
  for (int64_t y = cell_y - 1; y <= cell_y + 1; ++y) {
    for (int64_t x = cell_x - 1; x <= cell_x + 1; ++x) {
      const auto [begin, end] = cells_.equal_range(CellKey(x, y));
      for (auto it = begin; it != end; ++it) {
        const uint32_t idx = it->second;
        if (last_pair_[idx] == num_pairs_) continue;
        const double distance = (keypoints_[idx] - point).cast<double>().norm();
        // The order within a cell is not to matter.
        if (distance <= radius_px_ &&
            (distance < nearest_distance ||
             (distance == nearest_distance && idx < nearest))) {
          nearest = idx;
          nearest_distance = distance;
        }
      }
    }
  }
  return nearest;
}

std::vector<uint32_t> KeypointMerger::AddPair(
    const std::vector<Eigen::Vector2f>& points) {
  ++num_pairs_;
  std::vector<uint32_t> indices;
  indices.reserve(points.size());
  for (const Eigen::Vector2f& point : points) {
    DGSFM_CHECK(point.allFinite());
    uint32_t idx = FindNearest(point);
    if (idx == kNone) {
      idx = static_cast<uint32_t>(keypoints_.size());
      keypoints_.push_back(point);
      last_pair_.push_back(num_pairs_);
      // Cells are of the size of the radius, so that neighbours are at most one
      // cell away.
      cells_.emplace(
          CellKey(static_cast<int64_t>(std::floor(point.x() / cell_size_px_)),
                  static_cast<int64_t>(std::floor(point.y() / cell_size_px_))),
          idx);
    }
    // Keeps later points of the same pair away from this key point.
    last_pair_[idx] = num_pairs_;
    indices.push_back(idx);
  }
  return indices;
}

}  // namespace dgsfm
