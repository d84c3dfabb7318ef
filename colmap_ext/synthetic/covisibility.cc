#include "colmap_ext/synthetic/covisibility.h"

#include <algorithm>

namespace dgsfm {

Covisibility::Covisibility(
    const std::map<colmap::image_t, SyntheticImage>& images, size_t num_points)
    : num_images_(images.size()), tracks_(num_points) {
  for (const auto& [image_id, image] : images) {
    for (colmap::point2D_t i = 0; i < image.point_idxs.size(); ++i) {
      const int point_idx = image.point_idxs[i];
      if (point_idx >= 0) tracks_[point_idx].push_back({image_id, i});
    }
  }
}

colmap::point2D_t Covisibility::FindKeypoint(int point_idx,
                                             colmap::image_t image_id) const {
  for (const Observation& observation : Track(point_idx)) {
    if (observation.image_id == image_id) return observation.point2D_idx;
  }
  return colmap::kInvalidPoint2DIdx;
}

std::vector<std::pair<colmap::image_t, int>> Covisibility::CountObservers(
    const std::vector<int>& point_idxs, colmap::image_t except) const {
  std::vector<int> counts(num_images_ + 1, 0);
  std::vector<colmap::image_t> observers;
  for (const int point_idx : point_idxs) {
    if (point_idx < 0) continue;
    for (const Observation& observation : Track(point_idx)) {
      if (observation.image_id == except) continue;
      if (counts[observation.image_id]++ == 0) {
        observers.push_back(observation.image_id);
      }
    }
  }
  std::sort(observers.begin(), observers.end());
  std::vector<std::pair<colmap::image_t, int>> result;
  for (const colmap::image_t image_id : observers) {
    result.emplace_back(image_id, counts[image_id]);
  }
  return result;
}

}  // namespace dgsfm
