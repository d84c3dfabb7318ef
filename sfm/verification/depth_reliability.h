// Which depth maps to believe. A map that has nothing to do with its image
// contradicts the matches of nearly all pairs; taken for true, it would cost
// the image its pairs.

#pragma once

#include "sfm/verification/pair_verification.h"

#include <vector>

namespace dgsfm {

// Images whose depth maps more pairs contradict than confirm, in increasing
// order. Against a map speak pairs that the epipolar geometry supports and the
// depth test rejects (DEPTH_INCONSISTENT), if there are at least two of them:
// one may just be false. For it speak valid pairs whose scale ratio it fixes
// well. Maps are judged one after the other, the worst first, and pairs of a
// map that is out no longer speak against the other one.
std::vector<colmap::image_t> FindUnreliableDepths(const PairGeometries& pairs);

}  // namespace dgsfm
