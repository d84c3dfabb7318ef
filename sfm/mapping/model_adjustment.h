// Bundle adjustment of models in progress.

#pragma once

#include "sfm/mapping/model_in_progress.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

// The registered image with the most points, the best anchor of the gauge; the
// smallest id among equals.
colmap::image_t AnchorImage(const colmap::Reconstruction& model);

// The constraints with refined poses as the model has them.
RigConstraints CurrentRigs(const MappingContext& context,
                           const RigConstraints& rigs,
                           const colmap::Reconstruction& model);

// Tightens the tolerance of adjustments of a model with little parallax, whose
// cost falls slowly along valleys.
void FollowValleys(const ModelInProgress& progress,
                   BundleAdjustmentOptions* adjustment);

// AdjustBundle with the constraints of the rigs as the model has them.
std::optional<double> Adjust(const MappingContext& context,
                             const BundleAdjustmentOptions& adjustment,
                             const CameraBeliefs& beliefs,
                             const RigConstraints& rigs,
                             const CenterPriors& center_priors,
                             colmap::Reconstruction* model);

// Rounds of adjustment, with a filter after each. Returns false if a solver
// failed or no point is left.
bool AdjustModel(const MappingContext& context,
                 ModelInProgress* progress,
                 MappingLog* log);

}  // namespace dgsfm
