// One log scale per image from the depth-scale ratios of pairs (DGSfM Sec.
// 3.3, "Global Scale Averaging").

#pragma once

#include <string>
#include <vector>

namespace dgsfm {

// log s_2 - log s_1 = log_ratio, where s_i multiplies depth map i.
struct RelativeLogScale {
  int node1 = 0;
  int node2 = 0;
  double log_ratio = 0;
  // Weight of the squared residual [1], > 0.
  double weight = 1;
};

struct ScaleAveragingOptions {
  // Reweighted least-squares steps of each phase.
  int max_num_iterations = 30;
  // Scale of the robust loss in log scale [1].
  double loss_scale = 0.1;
  // Mean change of the log scales below which the last phase has converged
  // [1]; the L1 phase stops at 1e-4 at the latest.
  double convergence_threshold = 1e-6;

  bool IsValid(std::string* error) const;
};

// Log scales of all nodes of a connected graph, gauge: 0 at fixed_node.
// An L1 start (IRLS) followed by a redescending loss (Geman-McClure).
// Returns false, log_scales unchanged, if the graph is not connected or a
// factorisation fails. Throws on ratios that are not finite, nodes out of
// range and weights that are not finite and positive.
[[nodiscard]] bool AverageScales(int num_nodes,
                                 const std::vector<RelativeLogScale>& ratios,
                                 int fixed_node,
                                 const ScaleAveragingOptions& options,
                                 std::vector<double>* log_scales);

}  // namespace dgsfm
