#include "estimators/scale_averaging.h"

#include "colmap_ext/check.h"
#include "estimators/graph.h"
#include "estimators/graph_laplacian.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// Residuals below this count as zero in the L1 phase [1].
constexpr double kL1Floor = 1e-4;

}  // namespace

bool ScaleAveragingOptions::IsValid(std::string* error) const {
  return CheckOption(max_num_iterations >= 1,
                     "max_num_iterations must be >= 1",
                     max_num_iterations,
                     error) &&
         CheckOption(
             loss_scale > 0, "loss_scale must be > 0", loss_scale, error) &&
         CheckOption(convergence_threshold >= 0,
                     "convergence_threshold must be >= 0",
                     convergence_threshold,
                     error);
}

bool AverageScales(int num_nodes,
                   const std::vector<RelativeLogScale>& ratios,
                   int fixed_node,
                   const ScaleAveragingOptions& options,
                   std::vector<double>* log_scales) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  std::vector<GraphEdge> edges;
  Eigen::VectorXd edge_weights(ratios.size());
  Eigen::VectorXd log_ratios(ratios.size());
  for (size_t e = 0; e < ratios.size(); ++e) {
    DGSFM_CHECK(std::isfinite(ratios[e].log_ratio))
        << "log ratio of edge " << e << " = " << ratios[e].log_ratio;
    DGSFM_CHECK(std::isfinite(ratios[e].weight) && ratios[e].weight > 0)
        << "weight of edge " << e << " = " << ratios[e].weight;
    edges.emplace_back(ratios[e].node1, ratios[e].node2);
    edge_weights(e) = ratios[e].weight;
    log_ratios(e) = ratios[e].log_ratio;
  }
  GraphLaplacianSolver solver(num_nodes, edges, fixed_node);
  for (const int component : ConnectedComponents(num_nodes, edges)) {
    if (component != 0) return false;
  }

  // Least squares, where L1 starts, is a phase of constant weight that is
  // over after one step.
  const ReweightingPhase least_squares_phase{[](double) { return 1.0; }, 1, 0};
  // A start for the last phase, which alone has to converge in full.
  const ReweightingPhase l1_phase{
      L1Weight(kL1Floor),
      options.max_num_iterations,
      std::max(kL1Floor, options.convergence_threshold)};
  const ReweightingPhase redescending_phase{
      GemanMcClureWeight(options.loss_scale),
      options.max_num_iterations,
      options.convergence_threshold};
  Eigen::VectorXd estimates = Eigen::VectorXd::Zero(num_nodes);
  const auto compute_residuals = [&]() -> Eigen::MatrixXd {
    Eigen::VectorXd residuals = log_ratios;
    for (size_t e = 0; e < edges.size(); ++e) {
      residuals(e) -= estimates(edges[e].second) - estimates(edges[e].first);
    }
    return residuals;
  };
  for (const ReweightingPhase& phase :
       {least_squares_phase, l1_phase, redescending_phase}) {
    if (!SolveReweighted(
            phase,
            edge_weights,
            compute_residuals,
            [&](const Eigen::MatrixXd& steps) { estimates += steps; },
            &solver)) {
      return false;
    }
  }
  log_scales->assign(estimates.begin(), estimates.end());
  return true;
}

}  // namespace dgsfm
