// Which observations meet in which blocks of a reduced camera system.

#pragma once

#include "colmap_ext/parallel.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dgsfm {

// Cameras and points of all observations, sorted by point and then by camera.
struct ObservationIndex {
  int num_cameras = 0;
  int num_points = 0;
  std::vector<int> cameras;
  std::vector<int> points;
};

// One block a pair of cameras with a common point; those of a camera follow
// each other, by the second camera, the first of them the diagonal.
class ObservationBlocks {
 public:
  // The observations must outlive this.
  explicit ObservationBlocks(const ObservationIndex& observations);

  int PointBegin(int point) const { return point_begin_[point]; }
  int PointEnd(int point) const { return point_begin_[point + 1]; }

  size_t NumBlocks() const { return block_cameras_.size(); }
  size_t BlockBegin(int camera) const { return block_begin_[camera]; }
  size_t BlockEnd(int camera) const { return block_begin_[camera + 1]; }
  // The second camera of a block.
  int OtherCamera(size_t block) const { return block_cameras_[block]; }
  bool IsDiagonal(size_t block) const {
    return std::binary_search(block_begin_.begin(), block_begin_.end(), block);
  }

  // Number of pairs of an observation with itself and those that follow it at
  // its point.
  int NumPairsFrom(int k) const {
    return PointEnd(observations_.points[k]) - k;
  }
  // The blocks of these pairs.
  const int* BlocksFrom(int k) const {
    return pair_blocks_.data() + pair_begin_[k];
  }

  // Calls function(first, last) for ranges of cameras of about equal work, one
  // a thread. In a range, observations are best gone through in their order:
  // their rows are more than caches hold.
  template <typename Function>
  void ForCameraRanges(int num_threads, const Function& function) const {
    const std::vector<int> begin = CameraRanges(num_threads);
    ParallelFor(begin.size() - 1, num_threads, [&](size_t i) {
      function(begin[i], begin[i + 1]);
    });
  }

 private:
  void IndexObservations();
  void IndexBlocks();
  void IndexPairs();
  std::vector<int> CameraRanges(int num_threads) const;

  const ObservationIndex& observations_;
  std::vector<int> point_begin_;
  // The observations by camera.
  std::vector<int> camera_begin_;
  std::vector<int> camera_observations_;
  std::vector<size_t> block_begin_;
  std::vector<int> block_cameras_;
  // First entry of each observation in pair_blocks_.
  std::vector<size_t> pair_begin_;
  std::vector<int> pair_blocks_;
};

}  // namespace dgsfm
