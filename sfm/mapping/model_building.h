// The stages that turn a start into a calibrated model: positioning,
// adjustment, self-calibration.

#pragma once

#include "estimators/position_alignment.h"
#include "sfm/intrinsics/camera_splitting.h"
#include "sfm/intrinsics/self_calibration.h"
#include "sfm/mapping/track_selection.h"
#include "sfm/mapping_context.h"

#include <functional>
#include <map>
#include <optional>

namespace dgsfm {

// A model on its way through the stages, and what is believed of its cameras.
struct ModelInProgress {
  colmap::Reconstruction model;
  ImageCameras cameras;
  CameraBeliefs beliefs;
  // Images that move together, once the poses in their rigs are known.
  RigConstraints rigs;
  // Positions of the images, once the model is in their frame, and how it came
  // there.
  CenterPriors center_priors;
  std::optional<Similarity3d> positions_from_start;
  // Key points that may get observations.
  UsedKeypoints used_keypoints;
  // Residual from which the loss of the final adjustments grows linearly [px].
  double final_loss_scale_px = 0;
};

// Returns a model with first positions, the same each time.
using ModelStart = std::function<colmap::Reconstruction()>;

// Adjusts a positioned model in rounds, with a filter after each. Returns false
// if a solver failed or no point is left.
bool AdjustModel(const MappingContext& context,
                 ModelInProgress* progress,
                 MappingLog* log);

// Positions and adjusts a started model, with shared intrinsics of all cameras
// of a kind, and from its start once more without the images that contradict
// theirs. Returns false if a solver failed or no point is left.
bool RefineModel(const MappingContext& context,
                 const ModelStart& start,
                 ModelInProgress* progress,
                 MappingLog* log);

// Estimates unknown poses of cameras in their rigs by those of the images of a
// refined model, joins these images, and adjusts the model again. Returns false
// if a solver failed or no point is left.
bool CalibrateSensors(const MappingContext& context,
                      ModelInProgress* progress,
                      MappingLog* log);

// Adapts the loss of the final adjustments to the model's errors, and frees the
// principal points that the model determines.
void CalibrateCameras(const MappingContext& context,
                      ModelInProgress* progress,
                      MappingLog* log);

// Adjusts the model as it is to stay and filters it; returns the number of
// observations that left.
size_t AdjustAgain(const MappingContext& context,
                   ModelInProgress* progress,
                   StageTimer* timer);

// Holds cameras whose intrinsics ran away at their values before the
// adjustment, which keeps their images.
void HoldImplausibleCameras(const MappingContext& context,
                            ModelInProgress* progress,
                            MappingLog* log);

// The adjustment that the finished model is at.
BundleAdjustmentOptions FinalAdjustment(const MappingContext& context,
                                        const ModelInProgress& progress);

// Adjusts models as the finished model was adjusted. The context and the
// progress must outlive it.
ModelAdjuster FinalAdjuster(const MappingContext& context,
                            const ModelInProgress& progress);

}  // namespace dgsfm
