// One log scale per image from the depth-scale ratios of pairs (DGSfM Sec.
// 3.3, "Global Scale Averaging").

#pragma once

#include "estimators/averaging/graph_averaging.h"

#include <vector>

namespace dgsfm {

// log s_2 - log s_1 = log_ratio, where s_i multiplies depth map i.
struct RelativeLogScale {
  int node1 = 0;
  int node2 = 0;
  double log_ratio = 0;
  // Standard deviation [1], > 0.
  double stddev = 0.1 / 3;
};

// Log scales of all nodes of a connected graph, gauge: 0 at fixed_node. See
// AverageDifferences for loss, failure and contract.
[[nodiscard]] bool AverageScales(int num_nodes,
                                 const std::vector<RelativeLogScale>& ratios,
                                 int fixed_node,
                                 const GraphAveragingOptions& options,
                                 std::vector<double>* log_scales);

}  // namespace dgsfm
