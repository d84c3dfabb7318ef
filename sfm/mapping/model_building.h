// The stages that turn a start into a calibrated model: positioning,
// adjustment, self-calibration.

#pragma once

#include "sfm/intrinsics/self_calibration.h"
#include "sfm/mapping/model_in_progress.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

// Positions and adjusts a started model, with shared intrinsics of all cameras
// of a kind, and from its start once more without the images that contradict
// theirs. Of two starts, the model that explains more observations better
// stays, and images that do not move as far as these show are held at one
// centre. Returns false if a solver failed or no point is left.
bool RefineModel(const MappingContext& context,
                 const ModelStarts& starts,
                 ModelInProgress* progress,
                 MappingLog* log);

// Adapts the loss of the final adjustments to the model's errors, and frees the
// principal points that the model determines.
void CalibrateCameras(const MappingContext& context,
                      ModelInProgress* progress,
                      MappingLog* log);

// Frees the principal points that the model determines, and holds all others.
void FreePrincipalPoints(const MappingContext& context,
                         ModelInProgress* progress);

// Adjusts the model as it is to stay and filters it; returns the number of
// observations that left. The factor is that of the function tolerance.
size_t AdjustAgain(const MappingContext& context,
                   ModelInProgress* progress,
                   StageTimer* timer,
                   double tolerance_factor = 1);

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
