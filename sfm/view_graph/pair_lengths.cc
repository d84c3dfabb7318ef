#include "sfm/view_graph/pair_lengths.h"

#include "estimators/averaging/graph.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Key points that two pairs must share for a ratio of their lengths.
constexpr int kMinNumSharedPoints = 6;
// Ratios of a pair to stronger ones at each of its images, at most.
constexpr int kMaxNumRatios = 10;
// Angle between two rays below which they give no distance [deg]. Small: a
// false pair of look-alike views often claims that its images did not move.
constexpr double kMinRayAngleDeg = 0.1;

// Log distances of the key points of an image that one pair triangulates, in
// increasing order of the key points.
struct PairView {
  int pair = 0;
  std::vector<std::pair<colmap::point2D_t, double>> log_distances;
};

Eigen::Vector3d RayOf(const Scene& scene,
                      const colmap::Image& image,
                      colmap::point2D_t point2D_idx) {
  return scene.cameras.at(image.CameraId())
      .ImageToWorld(image.Point2D(point2D_idx).XY())
      .homogeneous()
      .normalized();
}

// Distances of the inliers from both centres, in units of the baseline.
std::pair<PairView, PairView> TriangulatePair(const Scene& scene,
                                              const ImageIndex& index,
                                              const IndexedPair& indexed) {
  const PairGeometry& pair = *indexed.pair;
  const colmap::Image& image1 = scene.images.at(index.IdOf(indexed.image1));
  const colmap::Image& image2 = scene.images.at(index.IdOf(indexed.image2));
  const Eigen::Matrix3d rotation =
      pair.cam2_from_cam1.rotation.toRotationMatrix();
  const double length = pair.cam2_from_cam1.translation.norm();
  const double max_cosine = std::cos(kMinRayAngleDeg * M_PI / 180);
  std::pair<PairView, PairView> views;
  if (length == 0) return views;
  const Eigen::Vector3d center2 =
      pair.cam2_from_cam1.TargetOriginInSource() / length;
  for (const colmap::FeatureMatch& match : pair.inlier_matches) {
    const Eigen::Vector3d ray1 = RayOf(scene, image1, match.point2D_idx1);
    const Eigen::Vector3d ray2 =
        rotation.transpose() * RayOf(scene, image2, match.point2D_idx2);
    const double cosine = ray1.dot(ray2);
    if (cosine > max_cosine) continue;
    // The points nearest to each other on both rays.
    const double along1 = ray1.dot(center2);
    const double along2 = ray2.dot(center2);
    const double sine2 = 1 - cosine * cosine;
    const double distance1 = (along1 - cosine * along2) / sine2;
    const double distance2 = (cosine * along1 - along2) / sine2;
    if (!(distance1 > 0) || !(distance2 > 0)) continue;
    views.first.log_distances.emplace_back(match.point2D_idx1,
                                           std::log(distance1));
    views.second.log_distances.emplace_back(match.point2D_idx2,
                                            std::log(distance2));
  }
  std::sort(views.first.log_distances.begin(), views.first.log_distances.end());
  std::sort(views.second.log_distances.begin(),
            views.second.log_distances.end());
  return views;
}

// Log of the distances of the first over those of the second, at the key points
// that both have.
std::vector<double> LogRatios(const PairView& view1, const PairView& view2) {
  std::vector<double> ratios;
  auto it = view2.log_distances.begin();
  for (const auto& [point2D_idx, log_distance] : view1.log_distances) {
    while (it != view2.log_distances.end() && it->first < point2D_idx) ++it;
    if (it == view2.log_distances.end()) break;
    if (it->first == point2D_idx) ratios.push_back(log_distance - it->second);
  }
  return ratios;
}

using PairViews = std::vector<PairView>;

// Views of the pairs by image, those with most points first.
std::vector<PairViews> ViewsOfImages(const Scene& scene,
                                     const ImageIndex& index,
                                     const std::vector<IndexedPair>& pairs) {
  std::vector<PairViews> views_of_images(index.Size());
  for (size_t i = 0; i < pairs.size(); ++i) {
    auto [view1, view2] = TriangulatePair(scene, index, pairs[i]);
    view1.pair = view2.pair = int(i);
    views_of_images[pairs[i].image1].push_back(std::move(view1));
    views_of_images[pairs[i].image2].push_back(std::move(view2));
  }
  for (PairViews& views : views_of_images) {
    std::stable_sort(
        views.begin(), views.end(), [](const auto& a, const auto& b) {
          return a.log_distances.size() > b.log_distances.size();
        });
  }
  return views_of_images;
}

// Ratios of the lengths of pairs that share an image.
std::vector<RelativeLogScale> RatiosOfLengths(
    const std::vector<PairViews>& views_of_images) {
  std::vector<RelativeLogScale> ratios;
  for (const PairViews& views : views_of_images) {
    for (size_t i = 0; i < views.size(); ++i) {
      int num_ratios = 0;
      for (size_t j = 0; j < i && num_ratios < kMaxNumRatios; ++j) {
        const std::vector<double> log_ratios = LogRatios(views[j], views[i]);
        if (int(log_ratios.size()) < kMinNumSharedPoints) continue;
        // The larger distances are in units of a length, the smaller it is.
        ratios.push_back({views[j].pair, views[i].pair, Median(log_ratios)});
        ++num_ratios;
      }
    }
  }
  return ratios;
}

}  // namespace

std::map<int, double> LengthsOfPairs(const Scene& scene,
                                     const ImageIndex& index,
                                     const std::vector<IndexedPair>& pairs,
                                     const GraphAveragingOptions& options) {
  std::vector<RelativeLogScale> ratios =
      RatiosOfLengths(ViewsOfImages(scene, index, pairs));
  std::map<int, double> lengths;
  if (ratios.empty()) return lengths;
  std::vector<GraphEdge> edges;
  for (const RelativeLogScale& ratio : ratios) {
    edges.emplace_back(ratio.node1, ratio.node2);
  }
  const std::vector<int> parts = ConnectedComponents(int(pairs.size()), edges);
  std::vector<int> node_of_pair(pairs.size(), -1);
  std::vector<int> pair_of_node;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (parts[i] != 0) continue;
    node_of_pair[i] = int(pair_of_node.size());
    pair_of_node.push_back(int(i));
  }
  std::vector<RelativeLogScale> connected;
  for (RelativeLogScale ratio : ratios) {
    if (parts[ratio.node1] != 0) continue;
    ratio.node1 = node_of_pair[ratio.node1];
    ratio.node2 = node_of_pair[ratio.node2];
    connected.push_back(ratio);
  }
  std::vector<double> log_lengths(pair_of_node.size(), 0.0);
  if (!AverageScales(int(pair_of_node.size()),
                     connected,
                     /*fixed_node=*/0,
                     options,
                     &log_lengths)) {
    LOG(WARNING) << "Averaging of lengths failed: no pair is filtered by them";
    return lengths;
  }
  const double median = Median(log_lengths);
  for (size_t i = 0; i < pair_of_node.size(); ++i) {
    lengths[pair_of_node[i]] = std::exp(log_lengths[i] - median);
  }
  return lengths;
}

}  // namespace dgsfm
