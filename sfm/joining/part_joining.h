// Which models of overlapping parts of a scene are in one frame.

#pragma once

#include "sfm/joining/part_alignment.h"

#include <string>
#include <vector>

namespace dgsfm {

// Parts in one frame.
struct PartGroup {
  std::vector<int> parts;
  std::vector<Similarity3d> group_from_part;
};

struct PartGroups {
  // Each part is in one, the groups of most images first. Gauge: rotation and
  // origin of the part with most images, and the median of the scales of all.
  std::vector<PartGroup> groups;
  // Why parts are not joined with others that they share images with, in
  // sentences that name both.
  std::vector<std::string> contradictions;
};

// Similarities between models that share images, from shared points and
// centres, and of models to the positions of their images, where these are
// known, averaged robustly over all: positions hold long rows of models. A
// model that contradicts its neighbours by more of its shared images than any
// other is left out, as long as there is one. Key points are numbered as
// UnifyKeypoints() does. Deterministic.
PartGroups GroupParts(const PartJoiningOptions& options,
                      const PosePriors& positions,
                      const std::vector<PartModel>& parts);

}  // namespace dgsfm
