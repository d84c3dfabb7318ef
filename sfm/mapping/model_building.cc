#include "sfm/mapping/model_building.h"

#include "sfm/georeferencing/georeferencing.h"
#include "sfm/mapping/model_access.h"
#include "sfm/mapping/model_adjustment.h"
#include "sfm/mapping/model_refinement.h"
#include "sfm/mapping/one_center_start.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/mapping/shared_center.h"

#include <algorithm>
#include <memory>
#include <set>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Rounds of refinement in which images may leave the cameras they share. Few
// leave in each: what the others contradict shows without them.
constexpr int kMaxNumTieRounds = 3;

bool PositionModel(const MappingContext& context,
                   ModelInProgress* progress,
                   MappingLog* log) {
  colmap::Reconstruction& model = progress->model;
  const DepthGlobalMapperOptions& options = context.options;
  if (model.NumPoints3D() == 0) return false;
  if (options.skip_global_positioning) return true;
  StageTimer timer("global_positioning");
  const GlobalPositioningSummary summary =
      PositionCameras(options.refinement.global_positioning,
                      context.verification.num_threads,
                      AnchorImage(model),
                      &model,
                      progress->rigs.frames);
  if (!summary.success) {
    LOG(ERROR) << "Global positioning failed: " << summary.message;
    return false;
  }
  UsePositions(context, AnchorImage(model), progress, log);
  const size_t num_filtered = FilterObservationsByAngle(
      options.refinement.max_angular_error_deg, &model);
  timer.Add("iterations", summary.num_iterations)
      .Add("converged", summary.converged)
      .Add("initial_cost", summary.initial_cost)
      .Add("final_cost", summary.final_cost)
      .Add("observations_filtered", double(num_filtered))
      .Add("points", double(model.NumPoints3D()));
  timer.Finish(&log->stages);
  return model.NumPoints3D() > 0;
}

SelfCalibrationOptions SelfCalibration(const MappingContext& context,
                                       const ModelInProgress& progress) {
  SelfCalibrationOptions options;
  options.bundle_adjustment = FinalAdjustment(context, progress);
  options.adjust = FinalAdjuster(context, progress);
  options.num_threads = context.verification.num_threads;
  return options;
}

// Takes images out of the cameras and groups that they contradict. Returns
// whether anything changed.
bool Untie(const MappingContext& context,
           const std::vector<colmap::image_t>& image_ids,
           ModelInProgress* progress,
           MappingLog* log) {
  ImageCameras& cameras = progress->cameras;
  const size_t num_tied = progress->beliefs.NumTiedCameras();
  const size_t num_split = cameras.origins.size();
  if (context.options.split_cameras) {
    const std::set<colmap::camera_t> shared = SharedCameras(cameras);
    std::set<colmap::camera_t> contradicted;
    for (const colmap::image_t image_id : image_ids) {
      const colmap::camera_t camera_id = cameras.camera_of_image.at(image_id);
      // Cameras of rigs stay what their sensors are.
      if (shared.count(camera_id) > 0 &&
          progress->rigs.frames.count(image_id) == 0) {
        contradicted.insert(camera_id);
      }
    }
    for (const colmap::camera_t camera_id : contradicted) {
      log->Warn("The images of camera " + std::to_string(camera_id) +
                " have focal lengths that differ by more than their errors: "
                "each gets a camera of its own where it differs "
                "(--split_cameras 0 keeps one)");
    }
    SplitCameras(contradicted, &cameras);
    AddSplitCameras(cameras.origins, &progress->beliefs);
  }
  UntieImages(cameras, image_ids, &progress->beliefs.groups);
  return cameras.origins.size() != num_split ||
         progress->beliefs.NumTiedCameras() != num_tied;
}

// Refines the model from where it starts, and where there is little parallax
// from one centre as well; the better one stays.
bool RefineFromStarts(const MappingContext& context,
                      const ModelStarts& starts,
                      ModelInProgress* progress,
                      MappingLog* log) {
  progress->has_little_parallax = starts.has_little_parallax;
  std::optional<ModelInProgress> turned;
  if (starts.from_one_center) turned = AtOneCenter(starts, *progress);
  const bool is_refined = PositionModel(context, progress, log) &&
                          AdjustModel(context, progress, log);
  if (!turned || !progress->center_priors.centers.empty()) return is_refined;
  return ReplaceIfBetterFromOneCenter(context,
                                      starts.num_observations,
                                      std::move(*turned),
                                      is_refined,
                                      progress,
                                      log);
}

bool RefineTied(const MappingContext& context,
                const ModelStarts& starts,
                ModelInProgress* progress,
                MappingLog* log) {
  const auto refine = [&] {
    return RefineFromStarts(context, starts, progress, log);
  };
  if (!context.options.TiesCameras()) return refine();
  TieCameraClasses(context.options.refinement.bundle_adjustment.intrinsics,
                   &progress->beliefs,
                   &progress->model);
  for (int round = 1; refine(); ++round) {
    if (round == kMaxNumTieRounds) return true;
    const std::vector<colmap::image_t> image_ids =
        FindContradictingImages(SelfCalibration(context, *progress),
                                progress->beliefs,
                                progress->model);
    if (image_ids.empty() || !Untie(context, image_ids, progress, log)) {
      return true;
    }
    // Positions that wrong ties led to are no start.
    progress->model = starts.from_pairs();
    UseCameras(progress->cameras, &progress->model);
  }
  return false;
}

}  // namespace

bool RefineModel(const MappingContext& context,
                 const ModelStarts& starts,
                 ModelInProgress* progress,
                 MappingLog* log) {
  if (!RefineTied(context, starts, progress, log)) return false;
  if (starts.from_one_center && progress->has_little_parallax &&
      progress->center_priors.centers.empty()) {
    HoldOneCenter(context, starts.depth_scales, progress, log);
  }
  return progress->model.NumPoints3D() > 0;
}

void FreePrincipalPoints(const MappingContext& context,
                         ModelInProgress* progress) {
  if (progress->has_little_parallax) {
    for (const auto& [camera_id, camera] : progress->model.Cameras()) {
      progress->beliefs.held_principal_points.insert(camera_id);
    }
    return;
  }
  progress->beliefs.held_principal_points.clear();
  progress->beliefs.held_distortions.clear();
  progress->beliefs = CalibrateModel(
      SelfCalibration(context, *progress), progress->beliefs, &progress->model);
}

void CalibrateCameras(const MappingContext& context,
                      ModelInProgress* progress,
                      MappingLog* log) {
  const DepthGlobalMapperOptions& options = context.options;
  if (!options.skip_loss_adaptation) {
    progress->final_loss_scales = AdaptedLossScales(
        options.refinement.bundle_adjustment, progress->model);
  }
  if (options.skip_self_calibration) return;
  StageTimer timer("self_calibration");
  FreePrincipalPoints(context, progress);
  const CameraBeliefs& beliefs = progress->beliefs;
  timer.Add("groups", double(beliefs.groups.size()))
      .Add("cameras", double(beliefs.NumTiedCameras()))
      .Add("principal_points_held",
           double(beliefs.held_principal_points.size()))
      .Add("distortions_held", double(beliefs.held_distortions.size()));
  timer.Finish(&log->stages);
}

size_t AdjustAgain(const MappingContext& context,
                   ModelInProgress* progress,
                   StageTimer* timer,
                   double tolerance_factor) {
  BundleAdjustmentOptions adjustment = FinalAdjustment(context, *progress);
  adjustment.function_tolerance *= tolerance_factor;
  if (progress->has_little_parallax) MoveStuckPoints(&progress->model);
  const std::optional<double> rms = Adjust(context,
                                           adjustment,
                                           progress->beliefs,
                                           progress->rigs,
                                           progress->center_priors,
                                           &progress->model);
  const size_t num_filtered =
      FilterObservations(context.options.refinement, 1.0, &progress->model);
  if (rms) {
    timer->Add("rms_px", *rms);
  } else {
    LOG(WARNING) << "The final bundle adjustment failed";
    timer->Add("adjustment_failed", 1);
  }
  timer->Add("observations_filtered", double(num_filtered))
      .Add("points", double(progress->model.NumPoints3D()));
  return num_filtered;
}

void HoldImplausibleCameras(const MappingContext& context,
                            ModelInProgress* progress,
                            MappingLog* log) {
  if (!context.options.HasFinalAdjustment()) return;
  colmap::Reconstruction& model = progress->model;
  const std::set<colmap::camera_t> implausible = ImplausibleCameras(model);
  if (implausible.empty()) return;
  for (const colmap::camera_t camera_id : implausible) {
    model.Camera(camera_id).SetParams(
        progress->cameras.cameras.at(camera_id).Params());
    progress->beliefs.held_cameras.insert(camera_id);
    for (CameraGroup& group : progress->beliefs.groups) {
      auto& ids = group.camera_ids;
      ids.erase(std::remove(ids.begin(), ids.end(), camera_id), ids.end());
    }
  }
  log->Warn("Bundle adjustment made the intrinsics of " +
            std::to_string(implausible.size()) +
            " cameras, the first of them camera " +
            std::to_string(*implausible.begin()) +
            ", implausible: they are held at the averages over image pairs. "
            "Give focal lengths (EXIF data) or leave their images out");
  Adjust(context,
         FinalAdjustment(context, *progress),
         progress->beliefs,
         progress->rigs,
         progress->center_priors,
         &model);
  FilterObservations(context.options.refinement, 1.0, &model);
}

BundleAdjustmentOptions FinalAdjustment(const MappingContext& context,
                                        const ModelInProgress& progress) {
  const DepthGlobalMapperOptions& options = context.options;
  BundleAdjustmentOptions adjustment = options.refinement.bundle_adjustment;
  FollowValleys(progress, &adjustment);
  adjustment.loss_scale_px = progress.final_loss_scales.soft_l1_px;
  adjustment.cauchy_scale_px = progress.final_loss_scales.cauchy_px;
  adjustment.intrinsics.refine_principal_point =
      options.refinement.refine_principal_point &&
      !options.skip_self_calibration;
  return adjustment;
}

ModelAdjuster FinalAdjuster(const MappingContext& context,
                            const ModelInProgress& progress) {
  return [&context, &progress](const CameraBeliefs& beliefs,
                               int max_num_iterations,
                               colmap::Reconstruction* model) {
    BundleAdjustmentOptions adjustment = FinalAdjustment(context, progress);
    adjustment.max_num_iterations =
        std::min(adjustment.max_num_iterations, max_num_iterations);
    return Adjust(context,
                  adjustment,
                  beliefs,
                  progress.rigs,
                  progress.center_priors,
                  model)
        .has_value();
  };
}

}  // namespace dgsfm
