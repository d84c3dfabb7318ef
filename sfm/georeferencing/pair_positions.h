// Image pairs against the positions of their images.

#pragma once

#include "colmap_ext/pose_prior.h"
#include "sfm/georeferencing/georeferencing_options.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

struct PairPositionFilter {
  // Pairs whose length could be compared with the distance of the positions.
  size_t num_tested = 0;
  // Images whose position most of their pairs contradict: the position is
  // wrong, not the pairs.
  size_t num_distrusted = 0;
  size_t num_filtered = 0;
};

// Takes out valid pairs whose translation, which depth gives a length, differs
// from the distance of the positions of their images by more than their errors
// and by more than a factor, such as pairs of look-alike places: they become
// POSITION_OUTLIER. Lengths count relative to the median one, since networks
// for depth are off by a common factor. No pair leaves if most contradict.
PairPositionFilter FilterByPosition(const GeoreferencingOptions& options,
                                    const PosePriors& priors,
                                    PairGeometries* pairs);

// The same as a stage.
void JudgePairsByPosition(const GeoreferencingOptions& options,
                          const PosePriors& priors,
                          PairGeometries* pairs,
                          MappingLog* log);

}  // namespace dgsfm
