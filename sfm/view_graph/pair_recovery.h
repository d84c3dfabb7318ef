// Pairs that averaged rotations bring back.

#pragma once

#include "sfm/mapping_context.h"
#include "sfm/view_graph/component_averaging.h"

namespace dgsfm {

// Verifies pairs among the images again that verification found no geometry
// for, or one that the averaged rotations contradict: with known rotations two
// matches determine the translation, so that few matches suffice, and wrong
// local minima are out of reach. Cameras count as known by their averaged focal
// lengths. Pairs whose geometry then is valid and within
// max_rotation_error_deg of the average come back; the others stay as they are.
void RecoverPairs(const MappingContext& context,
                  const ComponentRotations& rotations,
                  PairGeometries* pairs,
                  MappingLog* log);

}  // namespace dgsfm
