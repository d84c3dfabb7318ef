// Key points of one image from the points of its pairs.

#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// A point within `radius_px` of a key point from another pair becomes that key
// point (the nearest such), otherwise a new one: positions are those of the
// first point, never rounded or averaged. Points of one pair stay apart. The
// result depends on the order of the pairs alone.
class KeypointMerger {
 public:
  // radius_px >= 0; 0 merges equal positions.
  explicit KeypointMerger(double radius_px);

  // Indices of the key points of a pair's points.
  std::vector<uint32_t> AddPair(const std::vector<Eigen::Vector2f>& points);

  const std::vector<Eigen::Vector2f>& Keypoints() const { return keypoints_; }

 private:
  // Key of the cell with these coordinates.
  static uint64_t CellKey(int64_t x, int64_t y);
  uint32_t FindNearest(const Eigen::Vector2f& point) const;

  const double radius_px_;
  const double cell_size_px_;
  std::vector<Eigen::Vector2f> keypoints_;
  // Number of the pair that used a key point last.
  std::vector<uint32_t> last_pair_;
  uint32_t num_pairs_ = 0;
  std::unordered_multimap<uint64_t, uint32_t> cells_;
};

}  // namespace dgsfm
