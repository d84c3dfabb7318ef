// What an image sees by each of its pairs: depths that the pair triangulates.

#pragma once

#include "sfm/view_graph/view_graph.h"

#include <functional>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Key point of an image that a pair triangulates.
struct ViewedPoint {
  colmap::point2D_t point2D_idx = 0;
  // At depth one in the camera.
  Eigen::Vector2d normalized_point = Eigen::Vector2d::Zero();
  double log_depth = 0;  // in units of the pair's baseline
  double ray_angle_rad = 0;
};

// Those of one pair, in increasing order of the key points.
struct PairView {
  int pair = 0;  // its index
  std::vector<ViewedPoint> points;
};

// Calls visit(image, views) for each image of the index, from several threads
// at a time. Each pair of the image has a view, those with most points first;
// views of pairs that did not move are empty. Views are made of one image at a
// time: those of all would take as much memory as the matches.
void VisitViews(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    int num_threads,
    const std::function<void(int, const std::vector<PairView>&)>& visit);

// Median log of the depths of the first over those of the second, at the key
// points that both have; nothing if these are too few.
std::optional<double> LogRatio(const PairView& view1, const PairView& view2);

}  // namespace dgsfm
