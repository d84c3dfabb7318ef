// One frame for models that overlap, from the similarities between them.

#pragma once

#include "estimators/averaging/graph_averaging.h"
#include "estimators/position_alignment.h"

#include <vector>

namespace dgsfm {

// x_in_2 = node2_from_node1 * x_in_1.
struct RelativeSimilarity {
  int node1 = 0;
  int node2 = 0;
  Similarity3d node2_from_node1;
  // Where the two meet, in the frame of node1: the similarity is most certain
  // there.
  Eigen::Vector3d anchor_in_1 = Eigen::Vector3d::Zero();
  // Standard deviations of rotation [rad], log scale [1] and the anchor [unit
  // of node1], > 0.
  double rotation_stddev_rad = 1e-3;
  double log_scale_stddev = 1e-3;
  double anchor_stddev = 1e-3;
};

// world_from_node of all nodes of a connected graph: rotations, then scales,
// then translations are averaged robustly, see AverageRotations and
// AverageDifferences for loss, failure and contract. Gauge: identity at
// fixed_node.
[[nodiscard]] bool AverageSimilarities(
    int num_nodes,
    const std::vector<RelativeSimilarity>& similarities,
    int fixed_node,
    const GraphAveragingOptions& options,
    std::vector<Similarity3d>* world_from_node);

}  // namespace dgsfm
