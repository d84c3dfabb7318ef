// A small view graph.

#pragma once

#include "colmap_ext/pair_geometry.h"
#include "colmap_ext/scene.h"

#include <utility>
#include <vector>

namespace dgsfm {

inline PairGeometry ValidPair(size_t num_inliers) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.inlier_matches.resize(num_inliers);
  pair.depth_verified.resize(num_inliers, 1);
  return pair;
}

// Two triangles, images 1 2 3 and 4 5 6, linked by the pair (3, 4), and image
// 7 linked to 1 and 2 by weak pairs.
inline PairGeometries TwoTriangles() {
  PairGeometries pairs;
  for (const auto& [id1, id2] :
       std::vector<std::pair<colmap::image_t, colmap::image_t>>{
           {1, 2}, {2, 3}, {1, 3}, {4, 5}, {5, 6}, {4, 6}}) {
    pairs[PairIdOfImages(id1, id2)] = ValidPair(100);
  }
  pairs[PairIdOfImages(3, 4)] = ValidPair(20);
  pairs[PairIdOfImages(1, 7)] = ValidPair(30);
  pairs[PairIdOfImages(2, 7)] = ValidPair(20);
  return pairs;
}

}  // namespace dgsfm
