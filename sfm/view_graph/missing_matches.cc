#include "sfm/view_graph/missing_matches.h"

#include "sfm/view_graph/pair_views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

namespace {

// Views of a point that differ by less are found again [deg], [1].
constexpr double kMaxViewAngleDeg = 15.0;
constexpr double kMaxDistanceRatio = 1.4;
// Angle between the rays of another pair above which its depth shows where a
// feature should be [deg].
constexpr double kMinRayAngleDeg = 3.0;
// Other pairs whose features are looked for, those with most points.
constexpr int kMaxNumOtherViews = 8;
// Features next to the border may be outside the other image [of its size].
constexpr double kBorder = 0.05;
// Parts of the common area along each side, at most, and features that a part
// should have on average.
constexpr int kMaxGridSize = 4;
constexpr double kMeanNumFeatures = 16;
// Features that a part needs to be judged.
constexpr int kMinNumFeatures = 8;
// Share of features that are matched by accident where nothing is the same.
constexpr double kAccidentalShare = 0.02;
// Cost of declaring a part different, and the largest evidence of one part
// against a pair, as something may occlude it [nat].
constexpr double kPartCost = 4.0;
constexpr double kMaxPartEvidence = 8.0;

// Key point of an image that other pairs match.
struct Feature {
  Eigen::Vector3d point_in_cam;
  bool matched = false;  // by the pair
};

struct Part {
  int num_features = 0;
  int num_matched = 0;
};
using Parts = std::array<Part, kMaxGridSize * kMaxGridSize>;

// Feature of an image where it is in another [size of that].
struct SeenFeature {
  Eigen::Vector2d xy;
  bool matched = false;
};

// Parts of the area that has features: what two images have in common may be a
// strip of each.
Parts CountByPart(const std::vector<SeenFeature>& features) {
  Parts parts;
  Eigen::AlignedBox2d area;
  for (const SeenFeature& feature : features) area.extend(feature.xy);
  if (area.isEmpty() || !(area.sizes().minCoeff() > 0)) return parts;
  const int grid_size =
      std::clamp(int(std::sqrt(double(features.size()) / kMeanNumFeatures)),
                 1,
                 kMaxGridSize);
  for (const SeenFeature& feature : features) {
    const Eigen::Vector2d in_area =
        (feature.xy - area.min()).cwiseQuotient(area.sizes());
    const Eigen::Vector2i cell =
        (grid_size * in_area).cast<int>().cwiseMin(grid_size - 1);
    Part& part = parts[cell.y() * kMaxGridSize + cell.x()];
    ++part.num_features;
    part.num_matched += feature.matched;
  }
  return parts;
}

// Looks for the features of one image in another; the pose maps from the camera
// of the first.
Parts LookForFeatures(const std::vector<Feature>& features,
                      const Rigid3d& other_from_view,
                      const colmap::Camera& other) {
  std::vector<SeenFeature> seen;
  const Eigen::Matrix3d rotation = other_from_view.rotation.toRotationMatrix();
  const Eigen::Vector3d other_center = other_from_view.TargetOriginInSource();
  const double min_cosine = std::cos(kMaxViewAngleDeg * M_PI / 180);
  const Eigen::Vector2d size(other.Width(), other.Height());
  for (const auto& [point, matched] : features) {
    const Eigen::Vector3d in_other =
        rotation * point + other_from_view.translation;
    const double distance = point.norm();
    const double other_distance = in_other.norm();
    if (in_other.z() <= 0 || other_distance > kMaxDistanceRatio * distance ||
        distance > kMaxDistanceRatio * other_distance ||
        point.dot(point - other_center) <
            min_cosine * distance * other_distance) {
      continue;
    }
    const Eigen::Vector2d relative =
        other.WorldToImage(in_other.hnormalized()).cwiseQuotient(size);
    if (relative.minCoeff() < kBorder || relative.maxCoeff() > 1 - kBorder) {
      continue;
    }
    seen.push_back({relative, matched});
  }
  return CountByPart(seen);
}

double LogLikelihood(const Part& part, double matched_share) {
  return part.num_matched * std::log(matched_share) +
         (part.num_features - part.num_matched) * std::log(1 - matched_share);
}

double EvidenceOfParts(const Parts& parts) {
  // The share of matches where there are any.
  Part alive;
  for (const Part& part : parts) {
    if (part.num_matched <= 2 * kAccidentalShare * part.num_features) continue;
    alive.num_features += part.num_features;
    alive.num_matched += part.num_matched;
  }
  if (alive.num_features < kMinNumFeatures) return 0;
  const double share =
      std::min(0.98, double(alive.num_matched) / double(alive.num_features));
  double evidence = 0;
  for (const Part& part : parts) {
    if (part.num_features < kMinNumFeatures) continue;
    const double ratio = LogLikelihood(part, kAccidentalShare) -
                         LogLikelihood(part, share) - kPartCost;
    evidence += std::clamp(ratio, 0.0, kMaxPartEvidence);
  }
  return evidence;
}

// An image with what its pairs triangulate.
class ViewingImage {
 public:
  ViewingImage(const Scene& scene,
               const ImageIndex& index,
               const std::vector<IndexedPair>& pairs,
               int image,
               const std::vector<PairView>& views)
      : scene_(scene),
        index_(index),
        pairs_(pairs),
        image_(image),
        views_(views),
        num_views_(scene.images.at(index.IdOf(image)).NumPoints2D(), 0) {
    for (const PairView& view : views_) {
      for (const ViewedPoint& point : view.points) {
        ++num_views_[point.point2D_idx];
      }
    }
  }

  // Evidence that the other image of a view shows another place.
  double EvidenceAgainst(const PairView& view) const {
    const auto& [image1, image2, pair] = pairs_[size_t(view.pair)];
    const double length = pair->cam2_from_cam1.translation.norm();
    if (length == 0) return 0;
    Rigid3d other_from_view(pair->cam2_from_cam1.rotation,
                            pair->cam2_from_cam1.translation / length);
    if (image_ == image2) other_from_view = other_from_view.Inverse();
    const colmap::Image& other =
        scene_.images.at(index_.IdOf(image_ == image1 ? image2 : image1));
    return EvidenceOfParts(
        LookForFeatures(FeaturesIn(view),
                        other_from_view,
                        scene_.cameras.at(other.CameraId())));
  }

 private:
  // Features that other pairs match, in units of the baseline of this one.
  std::vector<Feature> FeaturesIn(const PairView& view) const {
    const IndexedPair& indexed = pairs_[size_t(view.pair)];
    std::vector<char> is_matched(num_views_.size(), false);
    for (const colmap::FeatureMatch& match : indexed.pair->inlier_matches) {
      is_matched[image_ == indexed.image1 ? match.point2D_idx1
                                          : match.point2D_idx2] = true;
    }
    std::vector<char> is_added(num_views_.size(), false);
    std::vector<Feature> features;
    const auto add = [&](const PairView& other, double log_scale) {
      for (const ViewedPoint& point : other.points) {
        const colmap::point2D_t idx = point.point2D_idx;
        if (is_added[idx] || num_views_[idx] <= int(is_matched[idx]) ||
            (&other != &view &&
             point.ray_angle_rad < kMinRayAngleDeg * M_PI / 180)) {
          continue;
        }
        is_added[idx] = true;
        features.push_back({std::exp(point.log_depth + log_scale) *
                                point.normalized_point.homogeneous(),
                            bool(is_matched[idx])});
      }
    };
    add(view, 0);
    int num_added = 0;
    for (const PairView& other : views_) {
      if (other.pair == view.pair) continue;
      const auto log_ratio = LogRatio(view, other);
      if (!log_ratio) continue;
      add(other, *log_ratio);
      if (++num_added == kMaxNumOtherViews) break;
    }
    return features;
  }

  const Scene& scene_;
  const ImageIndex& index_;
  const std::vector<IndexedPair>& pairs_;
  const int image_;
  const std::vector<PairView>& views_;
  // By key point.
  std::vector<int> num_views_;
};

}  // namespace

std::vector<double> EvidenceOfMissingMatches(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    int num_threads) {
  // By the first and by the second image of each pair.
  std::vector<std::array<double, 2>> evidence(pairs.size(), {0, 0});
  VisitViews(scene,
             index,
             pairs,
             num_threads,
             [&](int image, const std::vector<PairView>& views) {
               const ViewingImage viewing(scene, index, pairs, image, views);
               for (const PairView& view : views) {
                 const bool is_second =
                     pairs[size_t(view.pair)].image2 == image;
                 evidence[size_t(view.pair)][is_second] =
                     viewing.EvidenceAgainst(view);
               }
             });
  // A passer-by hides features in one of the images only.
  std::vector<double> of_pairs;
  for (const auto& [by_first, by_second] : evidence) {
    of_pairs.push_back(std::min(by_first, by_second));
  }
  return of_pairs;
}

}  // namespace dgsfm
