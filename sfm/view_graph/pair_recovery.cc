#include "sfm/view_graph/pair_recovery.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"

#include <cmath>
#include <optional>
#include <vector>

namespace dgsfm {

namespace {

// Pairs that another status excludes have been judged by more than their own
// matches.
bool IsRecoverable(PairStatus status) {
  return status == PairStatus::NO_GEOMETRY ||
         status == PairStatus::TOO_FEW_INLIERS ||
         status == PairStatus::LOW_INLIER_RATIO ||
         status == PairStatus::DEPTH_INCONSISTENT ||
         status == PairStatus::ROTATION_OUTLIER;
}

std::vector<colmap::image_pair_t> RecoverablePairs(
    const ImageIndex& index, const PairGeometries& pairs) {
  std::vector<colmap::image_pair_t> pair_ids;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (IsRecoverable(pair.status) && index.Of(image_id1) >= 0 &&
        index.Of(image_id2) >= 0) {
      pair_ids.push_back(pair_id);
    }
  }
  SortLongestFirst(pairs, &pair_ids);
  return pair_ids;
}

CameraMap KnownCameras(const Scene& scene) {
  CameraMap cameras = scene.cameras;
  for (auto& [camera_id, camera] : cameras) camera.SetPriorFocalLength(true);
  return cameras;
}

}  // namespace

void RecoverPairs(const MappingContext& context,
                  const ComponentRotations& rotations,
                  PairGeometries* pairs,
                  MappingLog* log) {
  if (context.options.skip_rotation_recovery) return;
  StageTimer timer("rotation_recovery");
  const Scene& scene = context.scene;
  const ImageIndex index(rotations.image_ids);
  const std::vector<colmap::image_pair_t> pair_ids =
      RecoverablePairs(index, *pairs);
  const CameraMap cameras = KnownCameras(scene);
  const auto image_of = [&](colmap::image_t image_id) {
    const colmap::Image& image = scene.images.at(image_id);
    const auto depths = context.depths.find(image_id);
    return PairImage{image,
                     cameras.at(image.CameraId()),
                     depths == context.depths.end() ? nullptr : &depths->second,
                     {}};
  };
  const double max_error_rad =
      context.options.averaging.max_rotation_error_deg * M_PI / 180;
  std::vector<std::optional<PairGeometry>> recovered(pair_ids.size());
  Progress progress("Recovering pairs", pair_ids.size());
  ParallelFor(pair_ids.size(), context.verification.num_threads, [&](size_t i) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_ids[i]);
    const Eigen::Quaterniond rotation =
        rotations.cam_from_world[index.Of(image_id2)] *
        rotations.cam_from_world[index.Of(image_id1)].conjugate();
    PairGeometry pair = VerifyPair(image_of(image_id1),
                                   image_of(image_id2),
                                   MatchesOf(scene, pair_ids[i]),
                                   context.verification,
                                   rotation);
    if (pair.status == PairStatus::VALID &&
        pair.cam2_from_cam1.rotation.angularDistance(rotation) <=
            max_error_rad) {
      recovered[i] = std::move(pair);
    }
    progress.Step();
  });
  size_t num_recovered = 0;
  for (size_t i = 0; i < pair_ids.size(); ++i) {
    if (!recovered[i]) continue;
    ++num_recovered;
    pairs->at(pair_ids[i])
        .Replace(PairStage::ROTATION_RECOVERY, std::move(*recovered[i]));
  }
  timer.Add("pairs_verified", double(pair_ids.size()))
      .Add("pairs_recovered", double(num_recovered));
  timer.Finish(&log->stages);
}

}  // namespace dgsfm
