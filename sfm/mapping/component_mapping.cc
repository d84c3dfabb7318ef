#include "sfm/mapping/component_mapping.h"

#include "colmap_ext/model/registered_images.h"
#include "colmap_ext/pose_access.h"
#include "colmap_ext/process_memory.h"
#include "sfm/georeferencing/georeferencing.h"
#include "sfm/intrinsics/calibration_check.h"
#include "sfm/intrinsics/camera_model_check.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping/model_adjustment.h"
#include "sfm/mapping/model_completion.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/mapping/sensor_calibration.h"
#include "sfm/mapping/shared_center.h"
#include "sfm/mapping/split_half.h"

#include <algorithm>
#include <cmath>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Median angle between the outermost rays of tracks up to which a start from
// one centre is tried, and up to which there is little parallax whichever start
// is better [deg].
constexpr double kMaxRayAngleDeg = 6;
constexpr double kLittleRayAngleDeg = 2.5;

// Why an image whose pairs give it a rotation has no position.
std::string WhyNotPositioned(colmap::image_t image_id,
                             const PairGeometries& pairs) {
  size_t num_valid = 0, num_rotation_only = 0;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (pair.status != PairStatus::VALID ||
        (image_id1 != image_id && image_id2 != image_id)) {
      continue;
    }
    ++num_valid;
    num_rotation_only += pair.Has(PairDegeneracy::ROTATION_ONLY);
  }
  if (2 * num_rotation_only <= num_valid) {
    return "sees too few tracks to be positioned";
  }
  return std::to_string(num_rotation_only) + " of its " +
         std::to_string(num_valid) +
         " valid pairs show a rotation only: a position needs images from "
         "other places, or depth";
}

struct AveragedPositions {
  ImageScales scales;
  AveragedCenters centers;
};

// Averages the depth scales and the translations of pairs, and takes out pairs
// whose translations contradict the others.
AveragedPositions AverageAndFilter(const MappingContext& context,
                                   const ComponentRotations& rotations,
                                   const ImageIndex& index,
                                   PairGeometries* pairs,
                                   MappingLog* log) {
  const DepthGlobalMapperOptions& options = context.options;
  StageTimer scale_timer("scale_averaging");
  ComponentScales scales = AverageComponentScales(
      options.averaging, options.skip_scale_averaging, index, pairs);
  scale_timer.Add("pairs", double(scales.num_pairs))
      .Add("outliers", double(scales.num_outliers))
      .Add("images", double(scales.scales.size()));
  scale_timer.Finish(&log->stages);
  if (options.skip_translation_averaging) return {scales.scales, {}};
  StageTimer translation_timer("translation_averaging");
  LengthFilterResult by_length =
      FilterByLength(options.averaging,
                     context.scene,
                     index,
                     rotations.cam_from_world,
                     context.verification.num_threads,
                     pairs);
  const size_t num_filtered = FilterByTranslation(
      options.averaging, index, rotations.cam_from_world, scales.scales, pairs);
  translation_timer
      .Add("pairs_filtered_by_length", double(by_length.num_pairs_filtered))
      .Add("pairs_filtered",
           double(by_length.num_pairs_filtered + num_filtered));
  translation_timer.Finish(&log->stages);
  return {std::move(scales.scales), std::move(by_length.centers)};
}

// A model of rotated images without positions and points.
colmap::Reconstruction CreateModel(const MappingContext& context,
                                   const ComponentRotations& rotations) {
  colmap::Reconstruction model;
  for (size_t i = 0; i < rotations.image_ids.size(); ++i) {
    colmap::Image image = context.scene.images.at(rotations.image_ids[i]);
    if (!model.ExistsCamera(image.CameraId())) {
      model.AddCamera(context.scene.cameras.at(image.CameraId()));
    }
    SetCamFromWorld({rotations.cam_from_world[i], Eigen::Vector3d::Zero()},
                    &image);
    model.AddImage(image);
  }
  return model;
}

ModelInProgress CreateProgress(const MappingContext& context,
                               const std::vector<colmap::image_t>& image_ids) {
  ModelInProgress progress;
  progress.cameras = CamerasOf(context.scene, image_ids);
  progress.beliefs = context.camera_beliefs;
  progress.final_loss_scales.soft_l1_px =
      context.options.refinement.bundle_adjustment.loss_scale_px;

  progress.rigs.frames = context.frames;
  progress.rigs.refined_cameras = KnownSensors(context.scene.rigs);
  progress.rigs.fix_scale = !context.options.refine_sensor_from_rig &&
                            HasBaseline(context.frames, image_ids);
  return progress;
}

void ReleaseInliers(const ImageIndex& index, PairGeometries* pairs) {
  for (auto& [pair_id, pair] : *pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (index.Of(image_id1) >= 0 && index.Of(image_id2) >= 0) {
      pair.ReleaseInliers();
    }
  }
  ReturnFreeMemory();
}

// A model with first positions, to which `starts` returns.
ModelInProgress StartModel(const MappingContext& context,
                           const ComponentRotations& rotations,
                           PairGeometries* pairs,
                           ModelStarts* starts,
                           MappingLog* log) {
  const ImageIndex index(rotations.image_ids);
  const AveragedPositions averaged =
      AverageAndFilter(context, rotations, index, pairs, log);
  ModelInProgress progress = CreateProgress(context, rotations.image_ids);
  StageTimer timer("initialization");
  const TrackOptions& track_options = context.options.tracks;
  auto established = EstablishTracks(index, *pairs, track_options);
  if (track_options.AreBounded()) {
    timer.Add("tracks_established", double(established.size()));
    established =
        SelectTracks(track_options, context.scene, std::move(established));
    progress.used_keypoints = KeypointsOf(established);
  }
  if (track_options.BoundStart(index.Size())) {
    progress.all_tracks =
        std::make_shared<const std::vector<colmap::Track>>(established);
    established = SelectTracks(
        track_options.OfStart(), context.scene, std::move(established));
  }
  const auto tracks = std::make_shared<const std::vector<colmap::Track>>(
      std::move(established));
  if (!context.options.skip_match_completion) ReleaseInliers(index, pairs);
  starts->depth_scales = averaged.scales;
  starts->from_pairs = [=, &context, &rotations] {
    colmap::Reconstruction model = CreateModel(context, rotations);
    InitializePositions(index,
                        *pairs,
                        context.depths,
                        averaged.scales,
                        *tracks,
                        context.options.position_initialization,
                        context.options.refinement.min_triangulation_angle_deg,
                        &model,
                        context.frames,
                        averaged.centers);
    return model;
  };
  progress.model = starts->from_pairs();
  for (const colmap::Track& track : *tracks) {
    starts->num_observations += track.Length();
  }
  const double ray_angle_deg = MedianRayAngleDeg(*tracks, progress.model);
  if (!context.options.skip_one_center_start && context.scene.rigs.Empty() &&
      ray_angle_deg <= kMaxRayAngleDeg) {
    starts->has_little_parallax = ray_angle_deg <= kLittleRayAngleDeg;
    starts->from_one_center = [=, &context, &rotations] {
      colmap::Reconstruction model = CreateModel(context, rotations);
      PlaceAtOneCenter(*tracks, &model);
      return model;
    };
  }
  ReturnFreeMemory();
  timer.Add("tracks", double(tracks->size()))
      .Add("images", double(progress.model.NumRegImages()))
      .Add("points", double(progress.model.NumPoints3D()));
  timer.Finish(&log->stages);
  return progress;
}

// Filters images, and gives the model its frame and unit.
void FinishModel(const MappingContext& context,
                 ModelInProgress* progress,
                 ComponentResult* result,
                 MappingLog* log) {
  StageTimer timer("metric_scale");
  colmap::Reconstruction* model = &progress->model;
  for (const auto& [image_id, reason] :
       FilterImages(context.options.refinement, progress->rigs.frames, model)) {
    result->unregistered_images[image_id] = reason;
  }
  RemovePointsWithoutDistance(model);
  if (!progress->rigs.refined_cameras.empty()) {
    UseUnitOfRigs(context.frames, progress);
  }
  MeasuredUnit unit;
  result->georeference = FinishFrame(context, progress, &unit, log);
  for (const auto& [image_id, scale] :
       DepthScalesOfModel(context.depths, *model)) {
    result->depth_scales[image_id] = scale.scale;
  }
  UpdatePointErrors(model);
  model->TearDown();
  if (const auto advice = CameraModelAdvice(MeasureRadialErrors(*model))) {
    log->Warn(*advice);
  }
  if (const auto advice =
          CalibratedFocalAdvice(context.options.refinement.bundle_adjustment
                                    .intrinsics.focal_length_stddev_ratio,
                                progress->beliefs.given,
                                *model)) {
    log->Warn(*advice);
  }
  if (const auto advice = ParallaxAdvice(
          context.options.refinement.min_triangulation_angle_deg, *model)) {
    log->Warn(*advice);
  }
  timer.Add("images", double(model->NumRegImages()))
      .Add("points", double(model->NumPoints3D()))
      .Add("scale_factor", std::exp(-unit.log_scale))
      .Add("log_scale_spread", unit.log_spread)
      .Add("images_with_scale", double(unit.num_images));
  if (progress->rigs.fix_scale) timer.Add("scale_by_rigs", 1);
  timer.Finish(&log->stages);
}

// Gives the cameras of the model the ids that they are written with, and fills
// in the result of each.
void FinishCameras(const MappingContext& context,
                   ModelInProgress* progress,
                   ComponentResult* result) {
  colmap::Reconstruction& model = progress->model;
  std::vector<CameraGroup>& groups = progress->beliefs.groups;
  KeepGroupsOf(model, &groups);
  const std::map<colmap::camera_t, colmap::camera_t> final_ids =
      context.options.share_intrinsics && context.scene.rigs.Empty()
          ? FirstOfGroups(groups)
          : JoinedCameraIds(progress->cameras.origins, groups, model);
  for (auto& [camera_id, camera] :
       SummarizeCameras(FinalAdjustment(context, *progress),
                        context.verification.num_threads,
                        progress->beliefs,
                        model)) {
    const auto final_id = final_ids.find(camera_id);
    result->cameras.emplace(
        final_id == final_ids.end() ? camera_id : final_id->second, camera);
  }
  const bool are_new =
      std::any_of(final_ids.begin(), final_ids.end(), [](const auto& ids) {
        return ids.first != ids.second;
      });
  if (are_new) RenameCameras(final_ids, &model);
}

void MeasureRepeatability(const MappingContext& context,
                          const ModelInProgress& progress,
                          ComponentResult* result,
                          MappingLog* log) {
  StageTimer timer("repeatability");
  result->repeatability = SplitHalfRepeatability(
      FinalAdjuster(context, progress),
      context.options.refinement.bundle_adjustment.max_num_iterations,
      progress.beliefs,
      progress.model);
  timer.Finish(&log->stages);
}

// From a refined model on; `is_refined` is whether that succeeded.
void CompleteComponent(const MappingContext& context,
                       bool is_refined,
                       bool measure_repeatability,
                       PairGeometries* pairs,
                       ModelInProgress* progress,
                       ComponentResult* result,
                       MappingLog* log) {
  colmap::Reconstruction& model = progress->model;
  const bool success = is_refined && CalibrateSensors(context, progress, log) &&
                       HoldSensors(context, progress, log);
  if (success) {
    CalibrateCameras(context, progress, log);
    CompleteTracks(context, *pairs, progress, log);
    JudgePairs(context, *progress, pairs);
    HoldImplausibleCameras(context, progress, log);
    if (measure_repeatability) {
      MeasureRepeatability(context, *progress, result, log);
    }
  }
  FinishModel(context, progress, result, log);
  const size_t min_model_size = MinModelSize(context);
  if (!success || model.NumRegImages() < min_model_size) {
    for (const colmap::image_t image_id : model.RegImageIds()) {
      result->unregistered_images[image_id] =
          success ? "its model has fewer than " +
                        std::to_string(min_model_size) + " images"
                  : "the optimisation of its model failed";
    }
    result->depth_scales.clear();
    return;
  }
  FinishCameras(context, progress, result);
  result->refined_sensors = progress->rigs.refined_cameras;
  result->model = std::make_unique<colmap::Reconstruction>(std::move(model));
}

}  // namespace

ComponentResult MapComponent(const MappingContext& context,
                             const ComponentRotations& rotations,
                             bool measure_repeatability,
                             PairGeometries* pairs,
                             MappingLog* log) {
  ComponentResult result;
  ModelStarts starts;
  ModelInProgress progress =
      StartModel(context, rotations, pairs, &starts, log);
  const bool is_refined = RefineModel(context, starts, &progress, log);
  starts = ModelStarts();
  for (const colmap::image_t image_id : rotations.image_ids) {
    if (!progress.model.IsImageRegistered(image_id)) {
      result.unregistered_images[image_id] = WhyNotPositioned(image_id, *pairs);
    }
  }
  CompleteComponent(context,
                    is_refined,
                    measure_repeatability,
                    pairs,
                    &progress,
                    &result,
                    log);
  return result;
}

}  // namespace dgsfm
