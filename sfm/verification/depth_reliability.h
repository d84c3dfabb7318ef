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
// against the maps of the other images; but those that were contradicted, and
// that no map which stays confirms, follow it.
std::vector<colmap::image_t> FindUnreliableDepths(const PairGeometries& pairs);

}  // namespace dgsfm
