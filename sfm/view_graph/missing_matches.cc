#include "sfm/view_graph/missing_matches.h"

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
// Features next to the border may be outside the other image [of its size].
constexpr double kBorder = 0.05;
// Parts of the common area along each side.
constexpr int kGridSize = 4;
// Features that a part needs to be judged.
constexpr int kMinNumFeatures = 8;
// Share of features that are matched by accident where nothing is the same.
constexpr double kAccidentalShare = 0.02;
// Cost of declaring a part different, and the largest evidence of one part
// against a pair, as something may occlude it [nat].
constexpr double kPartCost = 4.0;
constexpr double kMaxPartEvidence = 8.0;

using Features = std::vector<MissingMatches::Feature>;

struct Part {
  int num_features = 0;
  int num_matched = 0;
};
using Parts = std::array<Part, kGridSize * kGridSize>;

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
  for (const SeenFeature& feature : features) {
    const Eigen::Vector2d in_area =
        (feature.xy - area.min()).cwiseQuotient(area.sizes());
    const Eigen::Vector2i cell =
        (kGridSize * in_area).cast<int>().cwiseMin(kGridSize - 1);
    Part& part = parts[cell.y() * kGridSize + cell.x()];
    ++part.num_features;
    part.num_matched += feature.matched;
  }
  return parts;
}

// Looks for the features of one image in another; the pose maps from the camera
// of the first, in units of its depth map. The features that the pair matches
// are flagged.
Parts LookForFeatures(const Features& features,
                      const std::vector<bool>& is_matched,
                      const Rigid3d& other_from_view,
                      const colmap::Camera& other) {
  std::vector<SeenFeature> seen;
  const Eigen::Matrix3d rotation = other_from_view.rotation.toRotationMatrix();
  const Eigen::Vector3d other_center = other_from_view.TargetOriginInSource();
  const double min_cosine = std::cos(kMaxViewAngleDeg * M_PI / 180);
  const Eigen::Vector2d size(other.Width(), other.Height());
  for (const MissingMatches::Feature& feature : features) {
    const bool matched = is_matched[feature.point2D_idx];
    if (feature.num_matched_pairs <= int(matched)) continue;
    const Eigen::Vector3d& point = feature.point_in_cam;
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

}  // namespace

MissingMatches::MissingMatches(const Scene& scene,
                               const KeypointDepthMap& depths,
                               const PairGeometries& pairs)
    : scene_(scene), pairs_(pairs) {
  std::map<colmap::image_t, std::vector<int>> num_matched_pairs;
  for (const auto& [image_id, depths_of_image] : depths) {
    num_matched_pairs[image_id].resize(depths_of_image.depths.size(), 0);
  }
  const auto count = [&](colmap::image_t image_id, colmap::point2D_t idx) {
    const auto it = num_matched_pairs.find(image_id);
    if (it != num_matched_pairs.end()) ++it->second[idx];
  };
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    for (const colmap::FeatureMatch& match : pair.inlier_matches) {
      count(image_id1, match.point2D_idx1);
      count(image_id2, match.point2D_idx2);
    }
  }
  for (const auto& [image_id, counts] : num_matched_pairs) {
    const colmap::Image& image = scene.images.at(image_id);
    const colmap::Camera& camera = scene.cameras.at(image.CameraId());
    const std::vector<float>& depths_of_image = depths.at(image_id).depths;
    for (colmap::point2D_t i = 0; i < counts.size(); ++i) {
      if (counts[i] == 0 || !(depths_of_image[i] > 0)) continue;
      features_[image_id].push_back(
          {i,
           counts[i],
           depths_of_image[i] *
               camera.ImageToWorld(image.Point2D(i).XY()).homogeneous()});
    }
  }
}

double MissingMatches::EvidenceAgainst(colmap::image_pair_t pair_id) const {
  const PairGeometry& pair = pairs_.at(pair_id);
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  const auto features1 = features_.find(image_id1);
  const auto features2 = features_.find(image_id2);
  if (!pair.has_scale || features1 == features_.end() ||
      features2 == features_.end()) {
    return 0;
  }
  const colmap::Image& image1 = scene_.images.at(image_id1);
  const colmap::Image& image2 = scene_.images.at(image_id2);
  std::vector<bool> is_matched1(image1.NumPoints2D(), false);
  std::vector<bool> is_matched2(image2.NumPoints2D(), false);
  for (const colmap::FeatureMatch& match : pair.inlier_matches) {
    is_matched1[match.point2D_idx1] = true;
    is_matched2[match.point2D_idx2] = true;
  }
  // A passer-by hides features in one of the images only.
  return std::min(
      EvidenceOfParts(LookForFeatures(features1->second,
                                      is_matched1,
                                      pair.cam2_from_cam1,
                                      scene_.cameras.at(image2.CameraId()))),
      EvidenceOfParts(LookForFeatures(
          features2->second,
          is_matched2,
          InverseScaledPose(pair.cam2_from_cam1, pair.scale_1_from_2),
          scene_.cameras.at(image1.CameraId()))));
}

}  // namespace dgsfm
