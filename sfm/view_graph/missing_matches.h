// Evidence against pairs from matches that should be there and are not.

#pragma once

#include "sfm/view_graph/view_graph.h"

#include <vector>

namespace dgsfm {

// Log-likelihood ratio [nat] of "the images show different places" to "the
// parts without matches are accidental" for each pair, at least 0.
//
// Images of look-alike places agree where the places do, and have no matches at
// all where they differ. Features of one image that other pairs match, and so
// can be found again, are looked for in the other image: where both see them
// from nearly the same direction and distance, a true pair matches about the
// same share of them everywhere, and a false one none in whole parts of the
// area in common. Where in the other image a feature should be follows from the
// depth that its own pairs triangulate, in units of this pair's baseline by the
// key points that both triangulate; no depth map is needed. 0 for pairs whose
// images did not move.
std::vector<double> EvidenceOfMissingMatches(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    int num_threads);

}  // namespace dgsfm
