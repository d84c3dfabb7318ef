// A number that shows whether what an earlier run kept of a mapping still
// holds.

#pragma once

#include "sfm/verification/pair_verification.h"
#include "sfm/view_graph/pair_filters.h"

#include <string>

namespace dgsfm {

// 64-bit FNV-1a hash of all that RunGlobalMapping() takes, with the options as
// `options_text`, and of the version of its method.
uint64_t MappingFingerprint(const std::string& options_text,
                            const PairScores& pair_scores,
                            const Scene& scene,
                            const KeypointDepthMap& depths,
                            const PairGeometries& pairs);

}  // namespace dgsfm
