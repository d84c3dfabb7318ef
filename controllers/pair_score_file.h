#pragma once

#include "colmap_ext/scene.h"
#include "sfm/view_graph/pair_filters.h"

#include <string>

namespace dgsfm {

// Scores in [0, 1] of image pairs, either order of the names. The format
// follows from the extension:
// - .json: {"name1<>name2": score, ...}, or a list of [name1, name2, score] or
//   of {"image1": name1, "image2": name2, "score": score};
// - .csv: lines name1,name2,score, fields in quotes or not, with or without a
//   first line of titles;
// - otherwise lines "name1 name2 score", "name1<>name2 score" or
//   "name1<>name2<>score"; "#" starts a comment.
// A name is that of an image, or that without its folders where no other image
// has it.
//
// Throws std::runtime_error naming file and line (of JSON the entry) on
// malformed entries, unknown or ambiguous images and contradicting scores.
PairScores ReadPairScores(const std::string& path, const Scene& scene);

}  // namespace dgsfm
