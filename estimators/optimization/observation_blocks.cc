#include "estimators/optimization/observation_blocks.h"

#include "colmap_ext/check.h"

#include <numeric>
#include <utility>

namespace dgsfm {

PointRanges::PointRanges(const ObservationIndex& observations)
    : observations_(observations) {
  const size_t num_observations = observations_.cameras.size();
  DGSFM_CHECK(observations_.points.size() == num_observations);
  begin_.assign(observations_.num_points + 1, 0);
  for (size_t k = 0; k < num_observations; ++k) {
    const std::pair<int, int> key(observations_.points[k],
                                  observations_.cameras[k]);
    DGSFM_CHECK(k == 0 || std::make_pair(observations_.points[k - 1],
                                         observations_.cameras[k - 1]) <= key)
        << "observation " << k << " is out of order";
    ++begin_[key.first + 1];
  }
  std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
}

ObservationBlocks::ObservationBlocks(const ObservationIndex& observations,
                                     const PointRanges& ranges) {
  const ChunkByCamera by_camera(
      observations, ranges, 0, observations.num_points, /*num_ranges=*/1);
  const int* next = by_camera.Begin(0);
  std::vector<int> last_seen_by(observations.num_cameras, -1);
  block_begin_.assign(1, 0);
  for (int camera = 0; camera < observations.num_cameras; ++camera) {
    const size_t begin = block_cameras_.size();
    last_seen_by[camera] = camera;
    block_cameras_.push_back(camera);
    for (; next != by_camera.End(0) && observations.cameras[*next] == camera;
         ++next) {
      for (int l = *next + 1; l < *next + ranges.NumPairsFrom(*next); ++l) {
        const int other = observations.cameras[l];
        if (last_seen_by[other] == camera) continue;
        last_seen_by[other] = camera;
        block_cameras_.push_back(other);
      }
    }
    std::sort(block_cameras_.begin() + begin, block_cameras_.end());
    block_begin_.push_back(block_cameras_.size());
  }
  block_cameras_.shrink_to_fit();
}

ChunkByCamera::ChunkByCamera(const ObservationIndex& observations,
                             const PointRanges& ranges,
                             int first_point,
                             int last_point,
                             int num_ranges) {
  const int first = ranges.Begin(first_point);
  const int last = ranges.Begin(last_point);
  std::vector<int> next(observations.num_cameras + 1, 0);
  size_t num_pairs = 0;
  for (int k = first; k < last; ++k) {
    ++next[observations.cameras[k] + 1];
    num_pairs += size_t(ranges.NumPairsFrom(k));
  }
  std::partial_sum(next.begin(), next.end(), next.begin());
  ordered_.resize(last - first);
  for (int k = first; k < last; ++k) {
    ordered_[next[observations.cameras[k]]++] = k;
  }
  range_begin_.push_back(0);
  size_t num_seen = 0;
  for (size_t i = 0; i < ordered_.size(); ++i) {
    const int camera = observations.cameras[ordered_[i]];
    if (num_seen * num_ranges >= num_pairs * range_begin_.size() &&
        camera != observations.cameras[ordered_[i - 1]]) {
      range_begin_.push_back(i);
    }
    num_seen += size_t(ranges.NumPairsFrom(ordered_[i]));
  }
  range_begin_.push_back(ordered_.size());
}

}  // namespace dgsfm
