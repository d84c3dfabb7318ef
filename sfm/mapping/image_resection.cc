#include "sfm/mapping/image_resection.h"

#include "colmap_ext/model/registered_images.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_access.h"

#include <colmap/estimators/absolute_pose.h>
#include <colmap/optim/loransac.h>
#include <colmap/util/random.h>

#include <algorithm>
#include <optional>

namespace dgsfm {

namespace {

// A pose has to agree with so many times as many points as the one before ...
constexpr size_t kMinGain = 2;
// ... so that it is not looked for where this share of the points agrees.
constexpr double kMinAgreeingShare = 1.0 / (1 + kMinGain);
// Pairs of an image whose matches are read first.
constexpr size_t kNumSamplePairs = 6;
// P3P finds a pose with a tenth of inliers in so many samples with 99.9 %.
constexpr int kMaxNumTrials = 7000;
constexpr double kConfidence = 0.999;

// Key points of an image and the points at their matches.
struct PointMatches {
  std::vector<colmap::point2D_t> keypoints;
  std::vector<Eigen::Vector3d> points;
};

using PairsOfImages =
    std::map<colmap::image_t, std::vector<colmap::image_pair_t>>;

// Pairs of the images of a model.
PairsOfImages MatchedPairs(const Scene& scene,
                           const PairGeometries& pairs,
                           const colmap::Reconstruction& model) {
  PairsOfImages pairs_of_images;
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto pair = pairs.find(pair_id);
    if (pair != pairs.end() && StaysOut(pair->second.status)) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (!model.ExistsImage(image_id1) || !model.ExistsImage(image_id2)) {
      continue;
    }
    pairs_of_images[image_id1].push_back(pair_id);
    pairs_of_images[image_id2].push_back(pair_id);
  }
  return pairs_of_images;
}

// Whether two other images see the point, so that it does not depend on a wrong
// pose of the image.
bool IsSeenByOthers(const colmap::Point3D& point, colmap::image_t image_id) {
  const std::vector<colmap::TrackElement>& elements = point.Track().Elements();
  return std::count_if(elements.begin(),
                       elements.end(),
                       [&](const colmap::TrackElement& element) {
                         return element.image_id != image_id;
                       }) >= 2;
}

PointMatches MatchesWithPoints(
    const Scene& scene,
    const std::vector<colmap::image_pair_t>& pair_ids,
    const colmap::Reconstruction& model,
    colmap::image_t image_id) {
  std::vector<std::pair<colmap::point2D_t, colmap::point3D_t>> found;
  for (const colmap::image_pair_t pair_id : pair_ids) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const bool is_first = image_id1 == image_id;
    const colmap::image_t other_id = is_first ? image_id2 : image_id1;
    if (!IsRegistered(model, other_id)) continue;
    const colmap::Image& other = model.Image(other_id);
    for (const colmap::FeatureMatch& match : MatchesOf(scene, pair_id)) {
      const colmap::Point2D& feature =
          other.Point2D(is_first ? match.point2D_idx2 : match.point2D_idx1);
      if (feature.HasPoint3D()) {
        found.emplace_back(is_first ? match.point2D_idx1 : match.point2D_idx2,
                           feature.Point3DId());
      }
    }
  }
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  PointMatches point_matches;
  for (const auto& [keypoint, point_id] : found) {
    const colmap::Point3D& point = model.Point3D(point_id);
    if (!IsSeenByOthers(point, image_id)) continue;
    point_matches.keypoints.push_back(keypoint);
    point_matches.points.push_back(point.XYZ());
  }
  return point_matches;
}

// Points that a pose of the image projects to their key points.
size_t NumAgreeing(const colmap::Reconstruction& model,
                   colmap::image_t image_id,
                   const Rigid3d& cam_from_world,
                   const PointMatches& matches,
                   double max_error_px) {
  size_t num_agreeing = 0;
  for (size_t i = 0; i < matches.points.size(); ++i) {
    const Eigen::Vector3d in_cam = cam_from_world * matches.points[i];
    num_agreeing +=
        in_cam.z() > 0 &&
        ReprojectionError(model, {image_id, matches.keypoints[i]}, in_cam) <=
            max_error_px;
  }
  return num_agreeing;
}

// Whether half of the points agree with the image's pose at some of its pairs,
// so that the matches of all others need not be read.
bool IsSurelyRight(const MappingContext& context,
                   const std::vector<colmap::image_pair_t>& pair_ids,
                   const colmap::Reconstruction& model,
                   colmap::image_t image_id) {
  if (!model.IsImageRegistered(image_id)) return false;
  std::vector<colmap::image_pair_t> sample;
  const size_t step = pair_ids.size() / kNumSamplePairs + 1;
  for (size_t i = 0; i < pair_ids.size(); i += step) {
    sample.push_back(pair_ids[i]);
  }
  const PointMatches matches =
      MatchesWithPoints(context.scene, sample, model, image_id);
  const size_t num_agreeing =
      NumAgreeing(model,
                  image_id,
                  CamFromWorld(model.Image(image_id)),
                  matches,
                  context.options.refinement.max_reprojection_error_px);
  return num_agreeing >= size_t(context.verification.min_num_inliers) &&
         2 * num_agreeing >= matches.points.size();
}

Rigid3d RigidOf(const Eigen::Matrix3x4d& cam_from_world) {
  return {Eigen::Quaterniond(Eigen::Matrix3d(cam_from_world.leftCols<3>()))
              .normalized(),
          cam_from_world.col(3)};
}

// A pose that more points agree with than with the image's own, if it has one.
std::optional<Rigid3d> BetterPose(const MappingContext& context,
                                  const PointMatches& matches,
                                  const colmap::Reconstruction& model,
                                  colmap::image_t image_id) {
  const colmap::Image& image = model.Image(image_id);
  const colmap::Camera& camera = model.Camera(image.CameraId());
  const double max_error_px =
      context.options.refinement.max_reprojection_error_px;
  const size_t num_matches = matches.points.size();
  const size_t num_before =
      image.IsRegistered()
          ? NumAgreeing(
                model, image_id, CamFromWorld(image), matches, max_error_px)
          : 0;
  const PairVerificationOptions& verification = context.verification;
  const size_t min_num_agreeing = std::max<size_t>(
      {kMinGain * num_before,
       size_t(verification.min_num_inliers),
       size_t(verification.min_inlier_ratio * double(num_matches))});
  if (num_matches < min_num_agreeing ||
      double(num_before) >= kMinAgreeingShare * double(num_matches)) {
    return std::nullopt;
  }
  std::vector<Eigen::Vector2d> rays;
  for (const colmap::point2D_t keypoint : matches.keypoints) {
    rays.push_back(camera.ImageToWorld(image.Point2D(keypoint).XY()));
  }
  colmap::RANSACOptions ransac;
  ransac.max_error = camera.ImageToWorldThreshold(max_error_px);
  ransac.max_num_trials = kMaxNumTrials;
  ransac.confidence = kConfidence;
  ransac.min_inlier_ratio = double(min_num_agreeing) / double(num_matches);
  colmap::SetPRNGSeed(image_id);
  colmap::LORANSAC<colmap::P3PEstimator, colmap::EPNPEstimator> estimator(
      ransac);
  const auto report = estimator.Estimate(rays, matches.points);
  if (!report.success) return std::nullopt;
  const Rigid3d cam_from_world = RigidOf(report.model);
  if (NumAgreeing(model, image_id, cam_from_world, matches, max_error_px) <
      min_num_agreeing) {
    return std::nullopt;
  }
  return cam_from_world;
}

void PlaceImage(const Rigid3d& cam_from_world,
                colmap::image_t image_id,
                colmap::Reconstruction* model) {
  const size_t num_keypoints = model->Image(image_id).NumPoints2D();
  for (colmap::point2D_t i = 0; i < num_keypoints; ++i) {
    if (model->Image(image_id).Point2D(i).HasPoint3D()) {
      model->DeleteObservation(image_id, i);
    }
  }
  SetCamFromWorld(cam_from_world, &model->Image(image_id));
}

}  // namespace

ResectionSummary ResectImages(const MappingContext& context,
                              const PairGeometries& pairs,
                              ModelInProgress* progress) {
  ResectionSummary summary;
  if (!progress->rigs.frames.empty()) return summary;
  colmap::Reconstruction& model = progress->model;
  const PairsOfImages pairs_of_images =
      MatchedPairs(context.scene, pairs, model);
  std::vector<colmap::image_t> image_ids;
  for (const auto& [image_id, pair_ids] : pairs_of_images) {
    image_ids.push_back(image_id);
  }
  std::vector<std::optional<Rigid3d>> poses(image_ids.size());
  ParallelFor(
      image_ids.size(), context.verification.num_threads, [&](size_t i) {
        const auto& pair_ids = pairs_of_images.at(image_ids[i]);
        if (IsSurelyRight(context, pair_ids, model, image_ids[i])) return;
        poses[i] = BetterPose(
            context,
            MatchesWithPoints(context.scene, pair_ids, model, image_ids[i]),
            model,
            image_ids[i]);
      });
  for (size_t i = 0; i < image_ids.size(); ++i) {
    if (!poses[i]) continue;
    const bool is_registered = model.IsImageRegistered(image_ids[i]);
    PlaceImage(*poses[i], image_ids[i], &model);
    if (is_registered) {
      ++summary.num_moved;
    } else {
      model.RegisterImage(image_ids[i]);
      ++summary.num_registered;
    }
  }
  return summary;
}

}  // namespace dgsfm
