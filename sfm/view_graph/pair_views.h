// What an image sees by each of its pairs: depths that the pair triangulates.

#pragma once

#include "sfm/view_graph/view_graph.h"

#include <optional>
#include <vector>

namespace dgsfm {

// Key point of an image that a pair triangulates.
struct ViewedPoint {
  colmap::point2D_t point2D_idx = 0;
  double log_depth = 0;  // in units of the pair's baseline
  double ray_angle_rad = 0;
};

// Those of one pair, in increasing order of the key points.
struct PairView {
  int pair = 0;  // its index
  std::vector<ViewedPoint> points;
};

// Indices of the pairs of each image.
std::vector<std::vector<int>> PairsOfImages(
    const ImageIndex& index, const std::vector<IndexedPair>& pairs);

// The views of an image, one for each of its pairs; empty ones of pairs that
// did not move.
std::vector<PairView> ViewsOfImage(const Scene& scene,
                                   const ImageIndex& index,
                                   const std::vector<IndexedPair>& pairs,
                                   const std::vector<int>& pairs_of_image,
                                   int image);

// Median log of the depths of the first over those of the second, at the key
// points that both have; nothing if these are too few.
std::optional<double> LogRatio(const PairView& view1, const PairView& view2);

}  // namespace dgsfm
