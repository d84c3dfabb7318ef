// Which depth maps to believe. A map that has nothing to do with its image
// contradicts the matches of nearly all pairs; taken for true, it would cost
// the image its pairs.

#pragma once

#include "sfm/verification/pair_verification.h"

#include <vector>

namespace dgsfm {

// Images whose depth maps more pairs contradict than confirm, in increasing
// order. A map is contradicted by pairs that the epipolar geometry supports and
// the depth test rejects (DEPTH_INCONSISTENT), at least two of them, since one
// may be false. It is confirmed by valid pairs with a well-determined scale
// ratio. The worst map is taken out first, and its pairs then no longer count
// against the maps of the other images. In the end those follow that no map
// left confirms, and that more maps contradict than maps left have a scale with
// them, however uncertain.
std::vector<colmap::image_t> FindUnreliableDepths(const PairGeometries& pairs);

}  // namespace dgsfm
