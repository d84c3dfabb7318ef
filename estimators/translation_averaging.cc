#include "estimators/translation_averaging.h"

#include "colmap_ext/check.h"
#include "estimators/graph.h"
#include "estimators/graph_laplacian.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// Errors below this count as zero in the L1 phase [standard deviations].
constexpr double kL1Floor = 1e-2;
constexpr double kL1Convergence = 1e-4;

std::vector<Eigen::Vector3d> RowsOf(const Eigen::MatrixXd& matrix) {
  std::vector<Eigen::Vector3d> rows;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    rows.push_back(matrix.row(i).transpose());
  }
  return rows;
}

}  // namespace

bool TranslationAveragingOptions::IsValid(std::string* error) const {
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

std::vector<double> TranslationErrors(
    const std::vector<RelativeTranslation>& translations,
    const std::vector<Eigen::Vector3d>& centers) {
  std::vector<double> errors;
  for (const RelativeTranslation& relative : translations) {
    const Eigen::Vector3d estimate =
        centers.at(relative.node2) - centers.at(relative.node1);
    errors.push_back((estimate - relative.translation).norm() /
                     relative.stddev);
  }
  return errors;
}

bool AverageTranslations(int num_nodes,
                         const std::vector<RelativeTranslation>& translations,
                         int fixed_node,
                         const TranslationAveragingOptions& options,
                         std::vector<Eigen::Vector3d>* centers) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const Eigen::Index num_edges = Eigen::Index(translations.size());
  std::vector<GraphEdge> edges;
  Eigen::MatrixXd differences(num_edges, 3);
  Eigen::VectorXd weights(num_edges);
  for (Eigen::Index e = 0; e < num_edges; ++e) {
    const RelativeTranslation& relative = translations[e];
    DGSFM_CHECK(relative.translation.allFinite())
        << "translation of edge " << e << " is not finite";
    DGSFM_CHECK(std::isfinite(relative.stddev) && relative.stddev > 0)
        << "stddev of edge " << e << " = " << relative.stddev;
    edges.emplace_back(relative.node1, relative.node2);
    differences.row(e) = relative.translation.transpose();
    weights(e) = 1 / (relative.stddev * relative.stddev);
  }
  GraphLaplacianSolver solver(num_nodes, edges, fixed_node);
  for (const int component : ConnectedComponents(num_nodes, edges)) {
    if (component != 0) return false;
  }

  Eigen::MatrixXd solution;
  if (!solver.Solve(weights, differences, &solution)) return false;
  std::vector<Eigen::Vector3d> estimates = RowsOf(solution);
  const ReweightingPhase l1_phase{
      L1Weight(kL1Floor),
      options.max_num_iterations,
      std::max(kL1Convergence, options.convergence_threshold)};
  const ReweightingPhase redescending_phase{
      GemanMcClureWeight(options.loss_scale),
      options.max_num_iterations,
      options.convergence_threshold};
  for (const ReweightingPhase& phase : {l1_phase, redescending_phase}) {
    std::vector<double> errors = TranslationErrors(translations, estimates);
    for (int i = 0; i < phase.max_num_iterations; ++i) {
      Eigen::VectorXd robust_weights = weights;
      for (Eigen::Index e = 0; e < num_edges; ++e) {
        robust_weights(e) *= phase.robust_weight(errors[e]);
      }
      if (!solver.Solve(robust_weights, differences, &solution)) return false;
      estimates = RowsOf(solution);
      const std::vector<double> previous = errors;
      errors = TranslationErrors(translations, estimates);
      double change = 0;
      for (Eigen::Index e = 0; e < num_edges; ++e) {
        change += std::abs(errors[e] - previous[e]);
      }
      if (change <= phase.step_convergence_threshold * double(num_edges)) {
        break;
      }
    }
  }
  *centers = std::move(estimates);
  return true;
}

}  // namespace dgsfm
