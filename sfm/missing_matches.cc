#include "sfm/missing_matches.h"

#include "estimators/ray_intersection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <vector>

namespace dgsfm {

namespace {

// Views of a point that differ by less are found again [deg], [1].
constexpr double kMaxViewAngleDeg = 15.0;
constexpr double kMaxDistanceRatio = 1.4;
// Features next to the border may be outside the other image [of its size].
constexpr double kBorder = 0.05;
// Parts of an image along each side.
constexpr int kGridSize = 4;
// Features that a part needs to be judged.
constexpr int kMinNumFeatures = 8;
// Share of features that are matched by accident where nothing is the same.
constexpr double kAccidentalShare = 0.02;
// What it costs to declare a part different, and the most that one part may
// say against a pair: something may stand in the way [nat].
constexpr double kPartCost = 4.0;
constexpr double kMaxPartEvidence = 8.0;

struct View {
  const colmap::Image& image;
  const colmap::Camera& camera;
  const std::vector<float>& depths;
  const std::vector<int>& num_matched_pairs;
};

struct Part {
  int num_features = 0;
  int num_matched = 0;
};
using Parts = std::array<Part, kGridSize * kGridSize>;

// Looks for the features of `view` in `other`; the pose maps from the camera of
// view, in units of its depth map.
Parts LookForFeatures(const View& view,
                      const View& other,
                      const Rigid3d& other_from_view,
                      const std::set<colmap::point2D_t>& matched) {
  Parts parts;
  const Eigen::Vector3d other_center = other_from_view.TargetOriginInSource();
  const Eigen::Vector2d size(other.camera.Width(), other.camera.Height());
  for (colmap::point2D_t i = 0; i < view.image.NumPoints2D(); ++i) {
    const bool is_matched = matched.count(i) > 0;
    if (view.depths[i] <= 0 || view.num_matched_pairs[i] <= int(is_matched)) {
      continue;
    }
    const Eigen::Vector3d point =
        view.depths[i] *
        view.camera.ImageToWorld(view.image.Point2D(i).XY()).homogeneous();
    const Eigen::Vector3d in_other = other_from_view * point;
    const double log_distance_ratio = std::log(in_other.norm() / point.norm());
    if (in_other.z() <= 0 ||
        std::abs(log_distance_ratio) > std::log(kMaxDistanceRatio) ||
        AngleDeg(point, point - other_center) > kMaxViewAngleDeg) {
      continue;
    }
    const Eigen::Vector2d relative =
        other.camera.WorldToImage(in_other.hnormalized()).cwiseQuotient(size);
    if (relative.minCoeff() < kBorder || relative.maxCoeff() > 1 - kBorder) {
      continue;
    }
    const Eigen::Vector2i cell = (kGridSize * relative).cast<int>();
    Part& part = parts[cell.y() * kGridSize + cell.x()];
    ++part.num_features;
    part.num_matched += is_matched;
  }
  return parts;
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

}  // namespace

MissingMatches::MissingMatches(const Scene& scene,
                               const KeypointDepthMap& depths,
                               const PairGeometries& pairs)
    : scene_(scene), depths_(depths), pairs_(pairs) {
  for (const auto& [image_id, image] : scene.images) {
    num_matched_pairs_[image_id].resize(image.NumPoints2D(), 0);
  }
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    for (const colmap::FeatureMatch& match : pair.inlier_matches) {
      ++num_matched_pairs_[image_id1][match.point2D_idx1];
      ++num_matched_pairs_[image_id2][match.point2D_idx2];
    }
  }
}

double MissingMatches::EvidenceAgainst(colmap::image_pair_t pair_id) const {
  const PairGeometry& pair = pairs_.at(pair_id);
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  if (!pair.has_scale || depths_.count(image_id1) == 0 ||
      depths_.count(image_id2) == 0) {
    return 0;
  }
  const auto view_of = [&](colmap::image_t image_id) {
    const colmap::Image& image = scene_.images.at(image_id);
    return View{image,
                scene_.cameras.at(image.CameraId()),
                depths_.at(image_id).depths,
                num_matched_pairs_.at(image_id)};
  };
  const View view1 = view_of(image_id1);
  const View view2 = view_of(image_id2);
  std::set<colmap::point2D_t> matched1, matched2;
  for (const colmap::FeatureMatch& match : pair.inlier_matches) {
    matched1.insert(match.point2D_idx1);
    matched2.insert(match.point2D_idx2);
  }
  // A passer-by hides features in one of the images only.
  return std::min(
      EvidenceOfParts(
          LookForFeatures(view1, view2, pair.cam2_from_cam1, matched1)),
      EvidenceOfParts(LookForFeatures(
          view2,
          view1,
          InverseScaledPose(pair.cam2_from_cam1, pair.scale_1_from_2),
          matched2)));
}

}  // namespace dgsfm
