// Which observations meet in which blocks of a reduced camera system.

#pragma once

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

// Where the observations of each point are.
class PointRanges {
 public:
  // The observations must outlive this.
  explicit PointRanges(const ObservationIndex& observations);

  int Begin(int point) const { return begin_[point]; }
  int End(int point) const { return begin_[point + 1]; }

  // Number of pairs of an observation with itself and those that follow it at
  // its point.
  int NumPairsFrom(int k) const { return End(observations_.points[k]) - k; }

 private:
  const ObservationIndex& observations_;
  std::vector<int> begin_;
};

// One block a pair of cameras with a common point; those of a camera follow
// each other, by the second camera, the first of them the diagonal.
class ObservationBlocks {
 public:
  ObservationBlocks(const ObservationIndex& observations,
                    const PointRanges& ranges);

  size_t NumBlocks() const { return block_cameras_.size(); }
  size_t BlockBegin(int camera) const { return block_begin_[camera]; }
  size_t BlockEnd(int camera) const { return block_begin_[camera + 1]; }
  // The second camera of a block.
  int OtherCamera(size_t block) const { return block_cameras_[block]; }

 private:
  std::vector<size_t> block_begin_;
  std::vector<int> block_cameras_;
};

// The observations of a range of points by camera, in ranges of cameras of
// about equal work.
class ChunkByCamera {
 public:
  ChunkByCamera(const ObservationIndex& observations,
                const PointRanges& ranges,
                int first_point,
                int last_point,
                int num_ranges);

  size_t NumRanges() const { return range_begin_.size() - 1; }
  // Observations of the cameras of a range: those of a camera follow each
  // other, in their order.
  const int* Begin(size_t range) const {
    return ordered_.data() + range_begin_[range];
  }
  const int* End(size_t range) const {
    return ordered_.data() + range_begin_[range + 1];
  }

 private:
  std::vector<int> ordered_;
  std::vector<size_t> range_begin_;
};

}  // namespace dgsfm
