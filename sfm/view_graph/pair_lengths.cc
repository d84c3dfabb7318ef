#include "sfm/view_graph/pair_lengths.h"

#include "colmap_ext/parallel.h"
#include "estimators/averaging/graph.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/median.h"
#include "estimators/solvers/epipolar.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Key points that two pairs must share for a ratio of their lengths.
constexpr int kMinNumSharedPoints = 6;
// Ratios of a pair to stronger ones at each of its images, at most.
constexpr int kMaxNumRatios = 4;
// Angle between two rays below which they give no depth [deg]. Small: a
// false pair of look-alike views often claims that its images did not move.
constexpr double kMinRayAngleDeg = 0.1;

// Log depths of the key points of an image that one pair triangulates, in
// increasing order of the key points.
struct PairView {
  int pair = 0;
  std::vector<std::pair<colmap::point2D_t, double>> log_depths;
};

Eigen::Vector2d NormalizedPoint(const Scene& scene,
                                const colmap::Image& image,
                                colmap::point2D_t point2D_idx) {
  return scene.cameras.at(image.CameraId())
      .ImageToWorld(image.Point2D(point2D_idx).XY());
}

// The points of the key points of an image that pairs ask for, each computed
// once.
class NormalizedPoints {
 public:
  NormalizedPoints(const Scene& scene, const colmap::Image& image)
      : scene_(scene), image_(image), points_(image.NumPoints2D()) {}

  const Eigen::Vector2d& At(colmap::point2D_t point2D_idx) {
    std::optional<Eigen::Vector2d>& point = points_[point2D_idx];
    if (!point) point = NormalizedPoint(scene_, image_, point2D_idx);
    return *point;
  }

 private:
  const Scene& scene_;
  const colmap::Image& image_;
  std::vector<std::optional<Eigen::Vector2d>> points_;
};

// Depths of the inliers of a pair in one of its images, in units of the
// baseline. `points` are those of that image.
PairView ViewOfPair(const Scene& scene,
                    const ImageIndex& index,
                    const IndexedPair& indexed,
                    int image,
                    NormalizedPoints* points) {
  const PairGeometry& pair = *indexed.pair;
  PairView view;
  const double length = pair.cam2_from_cam1.translation.norm();
  if (length == 0) return view;
  TwoViewModel model;
  model.rotation = pair.cam2_from_cam1.rotation.toRotationMatrix();
  model.translation = pair.cam2_from_cam1.translation / length;
  model.focal1 = model.focal2 = 1;
  const bool is_first = image == indexed.image1;
  const colmap::Image& other_image =
      scene.images.at(index.IdOf(is_first ? indexed.image2 : indexed.image1));
  for (const colmap::FeatureMatch& match : pair.inlier_matches) {
    const colmap::point2D_t point2D_idx =
        is_first ? match.point2D_idx1 : match.point2D_idx2;
    const Eigen::Vector2d& x = points->At(point2D_idx);
    const Eigen::Vector2d other_x = NormalizedPoint(
        scene, other_image, is_first ? match.point2D_idx2 : match.point2D_idx1);
    const auto point =
        IntersectRays(model, is_first ? x : other_x, is_first ? other_x : x);
    if (!point || point->angle_rad < kMinRayAngleDeg * M_PI / 180) continue;
    view.log_depths.emplace_back(
        point2D_idx, std::log(is_first ? point->depth1 : point->depth2));
  }
  std::sort(view.log_depths.begin(), view.log_depths.end());
  return view;
}

// Log of the depths of the first over those of the second, at the key points
// that both have.
std::vector<double> LogRatios(const PairView& view1, const PairView& view2) {
  std::vector<double> ratios;
  auto it = view2.log_depths.begin();
  for (const auto& [point2D_idx, log_depth] : view1.log_depths) {
    while (it != view2.log_depths.end() && it->first < point2D_idx) ++it;
    if (it == view2.log_depths.end()) break;
    if (it->first == point2D_idx) ratios.push_back(log_depth - it->second);
  }
  return ratios;
}

// Ratios of the lengths of pairs at an image that they share.
std::vector<RelativeLogScale> RatiosAtImage(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    const std::vector<int>& pairs_of_image,
    int image) {
  NormalizedPoints points(scene, scene.images.at(index.IdOf(image)));
  std::vector<PairView> views;
  for (const int i : pairs_of_image) {
    views.push_back(ViewOfPair(scene, index, pairs[i], image, &points));
    views.back().pair = i;
  }
  // Those with most points first.
  std::stable_sort(
      views.begin(), views.end(), [](const auto& a, const auto& b) {
        return a.log_depths.size() > b.log_depths.size();
      });
  std::vector<RelativeLogScale> ratios;
  for (size_t i = 0; i < views.size(); ++i) {
    int num_ratios = 0;
    for (size_t j = 0; j < i && num_ratios < kMaxNumRatios; ++j) {
      const std::vector<double> log_ratios = LogRatios(views[j], views[i]);
      if (int(log_ratios.size()) < kMinNumSharedPoints) continue;
      // The larger depths are in units of a length, the smaller it is.
      ratios.push_back({views[j].pair, views[i].pair, Median(log_ratios)});
      ++num_ratios;
    }
  }
  return ratios;
}

// Views are made of one image at a time: those of all would take as much memory
// as the matches.
std::vector<RelativeLogScale> RatiosOfLengths(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    int num_threads) {
  std::vector<std::vector<int>> pairs_of_images(index.Size());
  for (size_t i = 0; i < pairs.size(); ++i) {
    pairs_of_images[pairs[i].image1].push_back(int(i));
    pairs_of_images[pairs[i].image2].push_back(int(i));
  }
  std::vector<std::vector<RelativeLogScale>> ratios_at_images(index.Size());
  ParallelFor(ratios_at_images.size(), num_threads, [&](size_t image) {
    ratios_at_images[image] =
        RatiosAtImage(scene, index, pairs, pairs_of_images[image], int(image));
  });
  std::vector<RelativeLogScale> ratios;
  for (const auto& at_image : ratios_at_images) {
    ratios.insert(ratios.end(), at_image.begin(), at_image.end());
  }
  return ratios;
}

}  // namespace

std::map<int, double> LengthsOfPairs(const Scene& scene,
                                     const ImageIndex& index,
                                     const std::vector<IndexedPair>& pairs,
                                     const GraphAveragingOptions& options,
                                     int num_threads) {
  const std::vector<RelativeLogScale> ratios =
      RatiosOfLengths(scene, index, pairs, num_threads);
  std::map<int, double> lengths;
  if (ratios.empty()) return lengths;
  std::vector<GraphEdge> edges;
  for (const RelativeLogScale& ratio : ratios) {
    edges.emplace_back(ratio.node1, ratio.node2);
  }
  const std::vector<int> pair_of_node =
      LargestComponent(int(pairs.size()), edges);
  std::vector<int> node_of_pair(pairs.size(), -1);
  for (size_t node = 0; node < pair_of_node.size(); ++node) {
    node_of_pair[pair_of_node[node]] = int(node);
  }
  std::vector<RelativeLogScale> connected;
  for (RelativeLogScale ratio : ratios) {
    if (node_of_pair[ratio.node1] < 0) continue;
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
