// Lengths of the translations of pairs by points that several pairs see: no
// depth is needed.

#pragma once

#include "estimators/averaging/scale_averaging.h"
#include "sfm/view_graph/view_graph.h"

#include <map>
#include <vector>

namespace dgsfm {

// Lengths of the translations of the pairs in a common unit, by index into
// `pairs`. Each pair triangulates its inliers with a baseline of length one; a
// key point that two pairs triangulate has one depth, which gives the ratio of
// their lengths. A pair that claims that its images did not move has a
// length close to zero. Only pairs of the largest part that such ratios connect
// have a length; none has if the averaging fails.
std::map<int, double> LengthsOfPairs(const Scene& scene,
                                     const ImageIndex& index,
                                     const std::vector<IndexedPair>& pairs,
                                     const GraphAveragingOptions& options,
                                     int num_threads);

}  // namespace dgsfm
