// Refinement of models whose rays hardly differ from one centre, which does not
// depend on the translations of pairs.

#pragma once

#include "sfm/mapping/model_in_progress.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

// The progress with the model as it starts from one centre.
ModelInProgress AtOneCenter(const ModelStarts& starts,
                            const ModelInProgress& progress);

// Grows and adjusts a model at one centre, and takes it over if it explains
// more of the start's observations better than the one in progress, which is
// none where is_refined is false. Returns whether there is a model.
bool ReplaceIfBetterFromOneCenter(const MappingContext& context,
                                  size_t num_observations_of_start,
                                  ModelInProgress turned,
                                  bool is_refined,
                                  ModelInProgress* progress,
                                  MappingLog* log);

// Holds all images at one centre if that explains the model as well as centres
// of their own; points then are where scaled depth maps have them.
void HoldOneCenter(const MappingContext& context,
                   const ImageScales& depth_scales,
                   ModelInProgress* progress,
                   MappingLog* log);

}  // namespace dgsfm
