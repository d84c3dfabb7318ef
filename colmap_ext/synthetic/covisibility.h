// Which images of a synthetic scene observe which of its points.

#pragma once

#include "colmap_ext/synthetic/synthetic_scene.h"

#include <colmap/util/types.h>

#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace dgsfm {

class Covisibility {
 public:
  struct Observation {
    colmap::image_t image_id;
    colmap::point2D_t point2D_idx;
  };

  // Images have ids from 1 without gaps.
  Covisibility(const std::map<colmap::image_t, SyntheticImage>& images,
               size_t num_points);

  // Ordered by image.
  const std::vector<Observation>& Track(int point_idx) const {
    return tracks_.at(point_idx);
  }
  // Key point of an image that shows the point, or kInvalidPoint2DIdx.
  colmap::point2D_t FindKeypoint(int point_idx, colmap::image_t image_id) const;

  // Images that observe some of the points, and how many, ordered by image;
  // negative indices are no points. `except` is left out.
  std::vector<std::pair<colmap::image_t, int>> CountObservers(
      const std::vector<int>& point_idxs, colmap::image_t except) const;

 private:
  size_t num_images_;
  std::vector<std::vector<Observation>> tracks_;  // by point
};

}  // namespace dgsfm
