#include "estimators/optimization/observation_blocks.h"

#include "colmap_ext/check.h"

#include <utility>

namespace dgsfm {

ObservationBlocks::ObservationBlocks(const ObservationIndex& observations)
    : observations_(observations) {
  IndexObservations();
  IndexBlocks();
  IndexPairs();
}

void ObservationBlocks::IndexObservations() {
  const size_t num_observations = observations_.cameras.size();
  DGSFM_CHECK(observations_.points.size() == num_observations);
  point_begin_.assign(observations_.num_points + 1, 0);
  camera_begin_.assign(observations_.num_cameras + 1, 0);
  for (size_t k = 0; k < num_observations; ++k) {
    const std::pair<int, int> key(observations_.points[k],
                                  observations_.cameras[k]);
    DGSFM_CHECK(k == 0 || std::make_pair(observations_.points[k - 1],
                                         observations_.cameras[k - 1]) <= key)
        << "observation " << k << " is out of order";
    ++point_begin_[key.first + 1];
    ++camera_begin_[key.second + 1];
  }
  for (int i = 0; i < observations_.num_points; ++i) {
    point_begin_[i + 1] += point_begin_[i];
  }
  for (int i = 0; i < observations_.num_cameras; ++i) {
    camera_begin_[i + 1] += camera_begin_[i];
  }
  camera_observations_.resize(num_observations);
  std::vector<int> next = camera_begin_;
  for (size_t k = 0; k < num_observations; ++k) {
    camera_observations_[next[observations_.cameras[k]]++] = int(k);
  }
}

void ObservationBlocks::IndexBlocks() {
  std::vector<int> last_seen_by(observations_.num_cameras, -1);
  block_begin_.assign(1, 0);
  for (int camera = 0; camera < observations_.num_cameras; ++camera) {
    const size_t begin = block_cameras_.size();
    last_seen_by[camera] = camera;
    block_cameras_.push_back(camera);
    for (int i = camera_begin_[camera]; i < camera_begin_[camera + 1]; ++i) {
      const int k = camera_observations_[i];
      for (int l = k + 1; l < k + NumPairsFrom(k); ++l) {
        const int other = observations_.cameras[l];
        if (last_seen_by[other] == camera) continue;
        last_seen_by[other] = camera;
        block_cameras_.push_back(other);
      }
    }
    std::sort(block_cameras_.begin() + begin, block_cameras_.end());
    block_begin_.push_back(block_cameras_.size());
  }
}

void ObservationBlocks::IndexPairs() {
  const int num_observations = int(observations_.cameras.size());
  pair_begin_.assign(num_observations + 1, 0);
  for (int k = 0; k < num_observations; ++k) {
    pair_begin_[k + 1] = pair_begin_[k] + NumPairsFrom(k);
  }
  pair_blocks_.resize(pair_begin_.back());
  std::vector<int> block_of(observations_.num_cameras);
  for (int camera = 0; camera < observations_.num_cameras; ++camera) {
    for (size_t block = BlockBegin(camera); block < BlockEnd(camera); ++block) {
      block_of[block_cameras_[block]] = int(block);
    }
    for (int i = camera_begin_[camera]; i < camera_begin_[camera + 1]; ++i) {
      const int k = camera_observations_[i];
      for (int j = 0; j < NumPairsFrom(k); ++j) {
        pair_blocks_[pair_begin_[k] + j] =
            block_of[observations_.cameras[k + j]];
      }
    }
  }
}

std::vector<int> ObservationBlocks::CameraRanges(int num_threads) const {
  const size_t num_ranges = EffectiveNumThreads(num_threads);
  std::vector<int> begin(1, 0);
  size_t num_pairs = 0;
  for (int camera = 0; camera < observations_.num_cameras; ++camera) {
    for (int i = camera_begin_[camera]; i < camera_begin_[camera + 1]; ++i) {
      num_pairs += NumPairsFrom(camera_observations_[i]);
    }
    if (num_pairs * num_ranges >= pair_blocks_.size() * begin.size()) {
      begin.push_back(camera + 1);
    }
  }
  if (begin.back() < observations_.num_cameras) {
    begin.push_back(observations_.num_cameras);
  }
  return begin;
}

}  // namespace dgsfm
