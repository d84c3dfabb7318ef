#include "sfm/view_graph/pair_views.h"

#include "colmap_ext/parallel.h"
#include "estimators/median.h"
#include "estimators/solvers/epipolar.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace dgsfm {

namespace {

// Key points that two pairs must share for a ratio of their lengths.
constexpr int kMinNumSharedPoints = 6;
// Angle between two rays below which they give no depth [deg]. Small: a
// false pair of look-alike views often claims that its images did not move.
constexpr double kMinRayAngleDeg = 0.1;

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
    view.points.push_back({point2D_idx,
                           x,
                           std::log(is_first ? point->depth1 : point->depth2),
                           point->angle_rad});
  }
  std::sort(view.points.begin(),
            view.points.end(),
            [](const ViewedPoint& a, const ViewedPoint& b) {
              return std::tie(a.point2D_idx, a.log_depth) <
                     std::tie(b.point2D_idx, b.log_depth);
            });
  return view;
}

}  // namespace

void VisitViews(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    int num_threads,
    const std::function<void(int, const std::vector<PairView>&)>& visit) {
  std::vector<std::vector<int>> pairs_of_images(index.Size());
  for (size_t i = 0; i < pairs.size(); ++i) {
    pairs_of_images[pairs[i].image1].push_back(int(i));
    pairs_of_images[pairs[i].image2].push_back(int(i));
  }
  ParallelFor(pairs_of_images.size(), num_threads, [&](size_t image) {
    NormalizedPoints points(scene, scene.images.at(index.IdOf(int(image))));
    std::vector<PairView> views;
    for (const int i : pairs_of_images[image]) {
      views.push_back(ViewOfPair(scene, index, pairs[i], int(image), &points));
      views.back().pair = i;
    }
    std::stable_sort(
        views.begin(), views.end(), [](const auto& a, const auto& b) {
          return a.points.size() > b.points.size();
        });
    visit(int(image), views);
  });
}

std::optional<double> LogRatio(const PairView& view1, const PairView& view2) {
  std::vector<double> ratios;
  auto it = view2.points.begin();
  for (const ViewedPoint& point : view1.points) {
    while (it != view2.points.end() && it->point2D_idx < point.point2D_idx) {
      ++it;
    }
    if (it == view2.points.end()) break;
    if (it->point2D_idx == point.point2D_idx) {
      ratios.push_back(point.log_depth - it->log_depth);
    }
  }
  if (int(ratios.size()) < kMinNumSharedPoints) return std::nullopt;
  return Median(ratios);
}

}  // namespace dgsfm
