// The frame of a joined model by the positions of its images.

#pragma once

#include "sfm/georeferencing/model_alignment.h"
#include "sfm/joining/joined_model.h"

#include <string>
#include <vector>

namespace dgsfm {

// Brings a joined model to the frame of the positions, if there are three or
// more. Its scale is theirs where they hold it well, and `has_scale` is false;
// else that of the parts. Positions that contradict the model are not used,
// which adds a warning.
ModelGeoreference PlaceAtPositions(const GeoreferencingOptions& options,
                                   const PosePriors& priors,
                                   bool has_scale,
                                   JoinedModel* model,
                                   std::vector<std::string>* warnings);

}  // namespace dgsfm
