// Averages the translations of pairs, and takes out those that contradict the
// average: a facade matched one window too far has the right rotation and
// scale, and only the loops of its pairs through other images contradict it.
// Such pairs become TRANSLATION_OUTLIER.

#pragma once

#include "sfm/view_graph/component_averaging.h"

#include <map>
#include <vector>

namespace dgsfm {

// Centres of images, in a unit of their own.
using AveragedCenters = std::map<colmap::image_t, Eigen::Vector3d>;

// Filters the scaled pairs among the images of the index with a scale, by their
// metric translations. Returns the number of pairs taken out.
size_t FilterByTranslation(
    const ComponentAveragingOptions& options,
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations,
    const ImageScales& scales,
    PairGeometries* pairs);

struct LengthFilterResult {
  size_t num_pairs_filtered = 0;
  // Averaged centres of the largest part that pairs with a length connect.
  AveragedCenters centers;
};

// Filters the valid pairs by translations of the lengths that points give them
// which several pairs see: no depth is needed.
LengthFilterResult FilterByLength(
    const ComponentAveragingOptions& options,
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations,
    int num_threads,
    PairGeometries* pairs);

}  // namespace dgsfm
