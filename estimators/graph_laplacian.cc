#include "estimators/graph_laplacian.h"

#include "colmap_ext/check.h"

#include <algorithm>

#include <Eigen/SparseCholesky>

namespace dgsfm {
namespace {

// Index among the values of a compressed matrix of an entry in its pattern.
int FindEntry(const Eigen::SparseMatrix<double>& matrix, int row, int col) {
  const int* rows = matrix.innerIndexPtr();
  const int* begin = rows + matrix.outerIndexPtr()[col];
  const int* end = rows + matrix.outerIndexPtr()[col + 1];
  return static_cast<int>(std::lower_bound(begin, end, row) - rows);
}

template <typename Factorization>
bool SolveFactorized(const Factorization& factorization,
                     const Eigen::MatrixXd& right_side,
                     Eigen::MatrixXd* unknowns) {
  if (factorization.info() != Eigen::Success) return false;
  *unknowns = factorization.solve(right_side);
  return factorization.info() == Eigen::Success && unknowns->allFinite();
}

}  // namespace

GraphLaplacianSolver::GraphLaplacianSolver(int num_nodes,
                                           const std::vector<GraphEdge>& edges,
                                           int fixed_node)
    : num_nodes_(num_nodes), fixed_node_(fixed_node) {
  DGSFM_CHECK(fixed_node >= 0 && fixed_node < num_nodes)
      << "fixed_node = " << fixed_node << " of " << num_nodes;
  // Rows of the unknowns: the nodes without the fixed one.
  const auto row_of = [&](int node) {
    DGSFM_CHECK(node >= 0 && node < num_nodes)
        << "node " << node << " of " << num_nodes;
    return node == fixed_node ? -1 : node - (node > fixed_node ? 1 : 0);
  };
  std::vector<Eigen::Triplet<double>> pattern;
  for (int row = 0; row < num_nodes - 1; ++row) {
    pattern.emplace_back(row, row, 1);
  }
  entries_.resize(edges.size());
  for (size_t e = 0; e < edges.size(); ++e) {
    entries_[e].row1 = row_of(edges[e].first);
    entries_[e].row2 = row_of(edges[e].second);
    const auto [low, high] = std::minmax(entries_[e].row1, entries_[e].row2);
    if (low >= 0 && low != high) pattern.emplace_back(high, low, 0);
  }
  laplacian_.resize(num_nodes - 1, num_nodes - 1);
  laplacian_.setFromTriplets(pattern.begin(), pattern.end());

  for (EdgeEntries& entry : entries_) {
    const auto [low, high] = std::minmax(entry.row1, entry.row2);
    if (low == high) continue;
    const auto diagonal = [&](int row) {
      return row < 0 ? -1 : FindEntry(laplacian_, row, row);
    };
    entry.diagonal1 = diagonal(entry.row1);
    entry.diagonal2 = diagonal(entry.row2);
    if (low >= 0) entry.off_diagonal = FindEntry(laplacian_, high, low);
  }
  // CHOLMOD would print its warnings; failures are reported by Solve.
  cholesky_.cholmod().print = 0;
  if (num_nodes > 1) cholesky_.analyzePattern(laplacian_);
}

bool GraphLaplacianSolver::Solve(const Eigen::VectorXd& weights,
                                 const Eigen::MatrixXd& differences,
                                 Eigen::MatrixXd* solution) {
  const auto num_edges = static_cast<Eigen::Index>(entries_.size());
  DGSFM_CHECK(weights.size() == num_edges && differences.rows() == num_edges);
  Eigen::MatrixXd right_side =
      Eigen::MatrixXd::Zero(num_nodes_ - 1, differences.cols());
  std::fill_n(laplacian_.valuePtr(), laplacian_.nonZeros(), 0.0);
  for (Eigen::Index e = 0; e < num_edges; ++e) {
    const EdgeEntries& entry = entries_[e];
    const double weight = weights(e);
    if (entry.diagonal1 >= 0) {
      laplacian_.valuePtr()[entry.diagonal1] += weight;
      right_side.row(entry.row1) -= weight * differences.row(e);
    }
    if (entry.diagonal2 >= 0) {
      laplacian_.valuePtr()[entry.diagonal2] += weight;
      right_side.row(entry.row2) += weight * differences.row(e);
    }
    if (entry.off_diagonal >= 0) {
      laplacian_.valuePtr()[entry.off_diagonal] -= weight;
    }
  }

  Eigen::MatrixXd unknowns(num_nodes_ - 1, differences.cols());
  if (num_nodes_ > 1) {
    cholesky_.factorize(laplacian_);
    if (!SolveFactorized(cholesky_, right_side, &unknowns)) {
      const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> fallback(
          laplacian_);
      if (!SolveFactorized(fallback, right_side, &unknowns)) return false;
    }
  }
  solution->resize(num_nodes_, differences.cols());
  solution->topRows(fixed_node_) = unknowns.topRows(fixed_node_);
  solution->row(fixed_node_).setZero();
  solution->bottomRows(num_nodes_ - 1 - fixed_node_) =
      unknowns.bottomRows(num_nodes_ - 1 - fixed_node_);
  return true;
}

std::function<double(double)> L1Weight(double floor) {
  return [floor](double norm) { return 1 / std::max(norm, floor); };
}

std::function<double(double)> GemanMcClureWeight(double scale) {
  return [sq_scale = scale * scale](double norm) {
    const double ratio = sq_scale / (sq_scale + norm * norm);
    return ratio * ratio;
  };
}

bool SolveReweighted(
    const ReweightingPhase& phase,
    const Eigen::VectorXd& edge_weights,
    const std::function<Eigen::MatrixXd()>& compute_residuals,
    const std::function<void(const Eigen::MatrixXd&)>& apply_steps,
    GraphLaplacianSolver* solver) {
  Eigen::MatrixXd steps;
  for (int i = 0; i < phase.max_num_iterations; ++i) {
    const Eigen::MatrixXd residuals = compute_residuals();
    Eigen::VectorXd weights(residuals.rows());
    for (Eigen::Index e = 0; e < residuals.rows(); ++e) {
      weights(e) =
          edge_weights(e) * phase.robust_weight(residuals.row(e).norm());
    }
    if (!solver->Solve(weights, residuals, &steps)) return false;
    apply_steps(steps);
    if (steps.rowwise().norm().mean() < phase.step_convergence_threshold) {
      break;
    }
  }
  return true;
}

}  // namespace dgsfm
