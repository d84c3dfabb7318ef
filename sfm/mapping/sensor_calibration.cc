#include "sfm/mapping/sensor_calibration.h"

#include "colmap_ext/model/registered_images.h"
#include "sfm/georeferencing/model_alignment.h"
#include "sfm/mapping/model_adjustment.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/mapping/shared_center.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <map>
#include <set>
#include <sstream>

#include <glog/logging.h>

namespace dgsfm {

namespace {

constexpr int kNumParams = 6;  // of a camera's pose in its rig
// How much more than expected held cameras may cost, over what is expected.
constexpr double kMaxExcessRatio = 5;
// Errors below this are those of the solver [px].
constexpr double kMinErrorPx = 0.01;

using Errors = std::map<colmap::camera_t, SensorError>;

// Known cameras with an image in the model, references aside.
std::set<colmap::camera_t> KnownSensorsOf(const MappingContext& context,
                                          const colmap::Reconstruction& model) {
  const std::set<colmap::camera_t> known = KnownSensors(context.scene.rigs);
  std::set<colmap::camera_t> with_images;
  for (const auto& [image_id, member] : context.frames) {
    if (IsRegistered(model, image_id) && known.count(member.camera_id) > 0) {
      with_images.insert(member.camera_id);
    }
  }
  return with_images;
}

// Takes out the camera whose rotation is farthest off.
void FreeWorst(const Errors& errors, std::set<colmap::camera_t>* held) {
  colmap::camera_t worst = *held->begin();
  for (const colmap::camera_t camera_id : *held) {
    if (errors.at(camera_id).rotation_rad > errors.at(worst).rotation_rad) {
      worst = camera_id;
    }
  }
  held->erase(worst);
}

// Joins the images of frames with these cameras held, and adjusts the model.
bool AdjustHeld(const MappingContext& context,
                const std::set<colmap::camera_t>& held,
                ModelInProgress* progress) {
  RigConstraints& rigs = progress->rigs;
  for (const colmap::camera_t camera_id : held) {
    rigs.refined_cameras.erase(camera_id);
  }
  UseUnitOfRigs(context.frames, progress);
  rigs.frames = context.frames;
  rigs = CurrentRigs(context, rigs, progress->model);
  JoinFrames(rigs.frames, &progress->model);
  return Adjust(context,
                context.options.refinement.bundle_adjustment,
                progress->beliefs,
                rigs,
                progress->center_priors,
                &progress->model)
      .has_value();
}

void WarnOfSensors(const Errors& errors,
                   const std::set<colmap::camera_t>& held,
                   MappingLog* log) {
  for (const auto& [camera_id, error] : errors) {
    if (held.count(camera_id) > 0) continue;
    std::ostringstream text;
    text << std::setprecision(2) << "The pose of camera " << camera_id
         << " in its rig contradicts the model, where it is turned by "
         << error.rotation_rad * 180 / M_PI << " degrees and moved by "
         << error.center
         << " (unit of the rig): it is refined. Check the calibration of the "
            "rig";
    log->Warn(text.str());
  }
}

}  // namespace

bool CalibrateSensors(const MappingContext& context,
                      ModelInProgress* progress,
                      MappingLog* log) {
  const std::set<colmap::camera_t> camera_ids =
      CamerasToCalibrate(context.scene.rigs, /*all=*/false);
  if (camera_ids.empty()) return true;
  RigConstraints& rigs = progress->rigs;
  rigs.refined_cameras.insert(camera_ids.begin(), camera_ids.end());
  rigs = CurrentRigs(context, rigs, progress->model);
  JoinFrames(rigs.frames, &progress->model);
  return AdjustModel(context, progress, log);
}

bool HoldSensors(const MappingContext& context,
                 ModelInProgress* progress,
                 MappingLog* log) {
  std::set<colmap::camera_t> held = KnownSensorsOf(context, progress->model);
  if (held.empty() || context.options.refine_sensor_from_rig ||
      context.options.skip_bundle_adjustment) {
    return true;
  }
  StageTimer timer("rigs");
  if (!AdjustHeld(context, {}, progress)) return false;
  const BundleAdjustmentOptions& adjustment =
      context.options.refinement.bundle_adjustment;
  const double refined_cost =
      CostOfObservations(adjustment.Loss(), progress->model);
  const double cost_of_param = std::max(
      refined_cost / double(2 * progress->model.ComputeNumObservations()),
      kMinErrorPx * kMinErrorPx / 2);
  const Errors errors = SensorErrors(held, progress->model, context.scene.rigs);
  std::optional<ModelInProgress> best;
  for (; !held.empty(); FreeWorst(errors, &held)) {
    ModelInProgress trial = *progress;
    if (!AdjustHeld(context, held, &trial)) continue;
    const double excess =
        CostOfObservations(adjustment.Loss(), trial.model) - refined_cost;
    const double expected = kNumParams * double(held.size()) * cost_of_param;
    VLOG(1) << held.size() << " cameras of rigs held cost " << excess / expected
            << " times what is expected";
    if (excess <= (1 + kMaxExcessRatio) * expected) {
      best = std::move(trial);
      break;
    }
  }
  WarnOfSensors(errors, held, log);
  if (best) *progress = std::move(*best);
  timer.Add("held", double(held.size()))
      .Add("refined", double(errors.size() - held.size()));
  timer.Finish(&log->stages);
  return AdjustModel(context, progress, log);
}

void UseUnitOfRigs(const FrameMembers& frames, ModelInProgress* progress) {
  if (!progress->rigs.fix_scale || !progress->center_priors.centers.empty()) {
    return;
  }
  const auto scale = ModelFromRigScale(frames, progress->model);
  if (!scale || !(*scale > 0)) return;
  Similarity3d similarity;
  similarity.scale = 1 / *scale;
  TransformModel(similarity, &progress->model);
}

}  // namespace dgsfm
