#pragma once

#include "colmap_ext/scene.h"
#include "sfm/view_graph.h"

#include <string>

namespace dgsfm {

// Reads lines "name1 name2 score" (either order of the names, score in
// [0, 1], "#" starts a comment). Throws std::runtime_error naming file and
// line on malformed lines, unknown images and contradicting scores.
PairScores ReadPairScores(const std::string& path, const Scene& scene);

}  // namespace dgsfm
