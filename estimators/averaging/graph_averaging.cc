#include "estimators/averaging/graph_averaging.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/check.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// Residuals below this count as zero in the L1 phase, and it ends when they
// change by less [standard deviations].
constexpr double kL1Floor = 0.1;

// Residuals beyond this have no influence in the last phase [scales of the
// loss]. That of the loss is small there, but pulls more on the side that a
// false edge agrees with: many of them tear far parts of a large graph apart.
constexpr double kMaxScaledResidual = 5.0;
// Weight of these, for the linear system needs one.
constexpr double kMinWeight = 1e-9;

// Triangles that give an edge full trust in the L1 phase, and trust without
// any.
constexpr double kMaxNumTriangles = 3;
constexpr double kMinTrust = 0.1;

struct Phase {
  Eigen::VectorXd edge_weights;
  std::function<double(double norm)> robust_weight;
  int max_num_iterations = 0;
  double convergence_threshold = 0;
};

// Whether three differences add up to zero within three standard deviations.
bool IsClosed(const Eigen::MatrixXd& differences,
              const Eigen::VectorXd& stddevs,
              const GraphLoop& loop) {
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(differences.cols());
  double variance = 0;
  for (const auto& [e, is_forward] : loop) {
    sum += (is_forward ? 1 : -1) * differences.row(e);
    variance += stddevs(e) * stddevs(e);
  }
  return sum.squaredNorm() <= 9 * variance;
}

// Mean over the edges of |x_2 - x_1| / stddev, whatever the gauge.
double MeanChange(const std::vector<GraphEdge>& edges,
                  const Eigen::VectorXd& stddevs,
                  const Eigen::MatrixXd& steps) {
  double sum = 0;
  for (size_t e = 0; e < edges.size(); ++e) {
    sum += (steps.row(edges[e].second) - steps.row(edges[e].first)).norm() /
           stddevs(e);
  }
  return edges.empty() ? 0 : sum / edges.size();
}

}  // namespace

bool GraphAveragingOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_num_l1_iterations", max_num_l1_iterations, 0)
      .AtLeast("max_num_irls_iterations", max_num_irls_iterations, 0)
      .Above("loss_scale", loss_scale, 0)
      .AtLeast("convergence_threshold", convergence_threshold, 0)
      .AreKept();
}

std::function<double(double)> L1Weight(double floor) {
  return [floor](double norm) { return 1 / std::max(norm, floor); };
}

std::function<double(double)> GemanMcClureWeight(double scale) {
  return [sq_scale = scale * scale](double norm) {
    const double sq_norm = norm * norm;
    if (sq_norm > kMaxScaledResidual * kMaxScaledResidual * sq_scale) {
      return kMinWeight;
    }
    const double ratio = sq_scale / (sq_scale + sq_norm);
    return ratio * ratio;
  };
}

Eigen::VectorXd TrustInTriangles(
    const std::vector<double>& num_closing_triangles) {
  Eigen::VectorXd trust(num_closing_triangles.size());
  for (Eigen::Index e = 0; e < trust.size(); ++e) {
    trust(e) =
        std::clamp(num_closing_triangles[e] / kMaxNumTriangles, kMinTrust, 1.0);
  }
  return trust;
}

bool AverageReweighted(
    const GraphAveragingOptions& options,
    const std::vector<GraphEdge>& edges,
    const Eigen::VectorXd& stddevs,
    const Eigen::VectorXd& weights,
    const Eigen::VectorXd& l1_trust,
    const std::function<Eigen::MatrixXd()>& compute_residuals,
    const std::function<void(const Eigen::MatrixXd&)>& apply_steps,
    GraphLaplacianSolver* solver) {
  const Eigen::VectorXd edge_weights =
      weights.array() / stddevs.array().square();
  const Phase l1_phase{l1_trust.cwiseProduct(edge_weights),
                       L1Weight(kL1Floor),
                       options.max_num_l1_iterations,
                       std::max(kL1Floor, options.convergence_threshold)};
  const Phase redescending_phase{edge_weights,
                                 GemanMcClureWeight(options.loss_scale),
                                 options.max_num_irls_iterations,
                                 options.convergence_threshold};
  Eigen::VectorXd robust_weights(stddevs.size());
  Eigen::MatrixXd steps;
  for (const Phase& phase : {l1_phase, redescending_phase}) {
    for (int i = 0; i < phase.max_num_iterations; ++i) {
      ThrowIfCancelled();
      const Eigen::MatrixXd residuals = compute_residuals();
      for (Eigen::Index e = 0; e < robust_weights.size(); ++e) {
        robust_weights(e) =
            phase.edge_weights(e) *
            phase.robust_weight(residuals.row(e).norm() / stddevs(e));
      }
      if (!solver->Solve(robust_weights, residuals, &steps)) return false;
      apply_steps(steps);
      if (MeanChange(edges, stddevs, steps) < phase.convergence_threshold) {
        break;
      }
    }
  }
  return true;
}

bool AverageDifferences(int num_nodes,
                        const std::vector<GraphEdge>& edges,
                        const Eigen::MatrixXd& differences,
                        const Eigen::VectorXd& stddevs,
                        int fixed_node,
                        const GraphAveragingOptions& options,
                        Eigen::MatrixXd* values) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(differences.allFinite()) << "differences are not finite";
  CheckStddevs(stddevs);
  GraphLaplacianSolver solver(num_nodes, edges, fixed_node);
  Eigen::MatrixXd estimates;
  const Eigen::VectorXd weights = stddevs.array().square().inverse();
  if (!solver.Solve(weights, differences, &estimates)) return false;
  const auto compute_residuals = [&]() {
    Eigen::MatrixXd residuals = differences;
    for (size_t e = 0; e < edges.size(); ++e) {
      residuals.row(e) -=
          estimates.row(edges[e].second) - estimates.row(edges[e].first);
    }
    return residuals;
  };
  if (!AverageReweighted(
          options,
          edges,
          stddevs,
          Eigen::VectorXd::Ones(stddevs.size()),
          TrustInTriangles(CountTriangles(num_nodes,
                                          edges,
                                          [&](const GraphLoop& loop) {
                                            return IsClosed(
                                                differences, stddevs, loop);
                                          })),
          compute_residuals,
          [&](const Eigen::MatrixXd& steps) { estimates += steps; },
          &solver)) {
    return false;
  }
  *values = std::move(estimates);
  return true;
}

void CheckStddevs(const Eigen::VectorXd& stddevs) {
  for (Eigen::Index e = 0; e < stddevs.size(); ++e) {
    DGSFM_CHECK(std::isfinite(stddevs(e)) && stddevs(e) > 0)
        << "stddev of edge " << e << " = " << stddevs(e);
  }
}

}  // namespace dgsfm
