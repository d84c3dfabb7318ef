// Models by the positions of their images: used while they are built, and
// for the frame that they are finished in.

#pragma once

#include "sfm/georeferencing/model_alignment.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping/model_building.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

// Brings a positioned model to the frame of the positions of its images and
// positions it again with these as priors, which stay in
// progress->center_priors. Does nothing where they do not hold the scale, or
// hold it worse than metric depth maps. Rigs that fix the scale keep it.
void UsePositions(const MappingContext& context,
                  colmap::image_t fixed_image,
                  ModelInProgress* progress,
                  MappingLog* log);

// Gives the finished model its frame and unit: those of the positions; or the
// unit of rigs or depth maps, and z upwards. `unit` is what depth maps said of
// it before, where the model got theirs.
ModelGeoreference FinishFrame(const MappingContext& context,
                              ModelInProgress* progress,
                              MeasuredUnit* unit,
                              MappingLog* log);

}  // namespace dgsfm
