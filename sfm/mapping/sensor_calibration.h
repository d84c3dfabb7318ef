// Poses of cameras in their rigs by a model.

#pragma once

#include "sfm/mapping/model_in_progress.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

// Estimates unknown poses of cameras in their rigs by those of the images of a
// refined model, joins these images, and adjusts the model again. Returns false
// if a solver failed or no point is left.
bool CalibrateSensors(const MappingContext& context,
                      ModelInProgress* progress,
                      MappingLog* log);

// Holds cameras at their given poses in the rigs, which were refined so far,
// and adjusts the model again. Where the observations contradict that, cameras
// stay refined, those that are farthest from their given pose first, with a
// warning; the baselines of the rigs then give the scale in the median. Returns
// false if a solver failed or no point is left.
bool HoldSensors(const MappingContext& context,
                 ModelInProgress* progress,
                 MappingLog* log);

// Brings a model to the unit in which its frames have the given baselines in
// the median, unless positions hold it.
void UseUnitOfRigs(const FrameMembers& frames, ModelInProgress* progress);

}  // namespace dgsfm
