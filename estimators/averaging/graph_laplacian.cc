#include "estimators/averaging/graph_laplacian.h"

#include "colmap_ext/check.h"

#include <algorithm>

#include <Eigen/IterativeLinearSolvers>

namespace dgsfm {
namespace {

// Factorisations with more multiplications than this, some 0.1 s, are slower
// than conjugate gradients [1].
constexpr double kMaxNumMultiplications = 1e8;

// Residual of the linear system, relative to the right side, at which
// conjugate gradients stop [1]: reweighted least squares solves again for what
// is left.
constexpr double kResidualTolerance = 1e-4;

// Index among the values of a compressed matrix of an entry in its pattern.
int FindEntry(const Eigen::SparseMatrix<double>& matrix, int row, int col) {
  const int* rows = matrix.innerIndexPtr();
  const int* begin = rows + matrix.outerIndexPtr()[col];
  const int* end = rows + matrix.outerIndexPtr()[col + 1];
  return static_cast<int>(std::lower_bound(begin, end, row) - rows);
}

// False without convergence.
bool SolveByConjugateGradients(const Eigen::SparseMatrix<double>& laplacian,
                               const Eigen::MatrixXd& right_side,
                               Eigen::MatrixXd* unknowns) {
  // Nodes without edges would get zero instead of a failure.
  if (!(Eigen::VectorXd(laplacian.diagonal()).minCoeff() > 0)) return false;
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>,
                           Eigen::Lower | Eigen::Upper>
      solver;
  solver.setTolerance(kResidualTolerance);
  *unknowns = solver.compute(laplacian).solve(right_side);
  return solver.info() == Eigen::Success && unknowns->allFinite();
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
    EdgeEntries& entry = entries_[e];
    entry.row1 = row_of(edges[e].first);
    entry.row2 = row_of(edges[e].second);
    if (entry.row1 < 0 || entry.row2 < 0 || entry.row1 == entry.row2) continue;
    pattern.emplace_back(entry.row1, entry.row2, 0);
    pattern.emplace_back(entry.row2, entry.row1, 0);
  }
  laplacian_.resize(num_nodes - 1, num_nodes - 1);
  laplacian_.setFromTriplets(pattern.begin(), pattern.end());

  for (EdgeEntries& entry : entries_) {
    const auto [row1, row2] = std::make_pair(entry.row1, entry.row2);
    if (row1 == row2) continue;
    if (row1 >= 0) entry.diagonal1 = FindEntry(laplacian_, row1, row1);
    if (row2 >= 0) entry.diagonal2 = FindEntry(laplacian_, row2, row2);
    if (row1 < 0 || row2 < 0) continue;
    entry.upper = FindEntry(laplacian_, row1, row2);
    entry.lower = FindEntry(laplacian_, row2, row1);
  }
  if (num_nodes == 1) return;
  ldlt_.analyzePattern(laplacian_);
  prefers_factorization_ = ldlt_.NumMultiplications() <= kMaxNumMultiplications;
}

bool GraphLaplacianSolver::Solve(const Eigen::VectorXd& weights,
                                 const Eigen::MatrixXd& differences,
                                 Eigen::MatrixXd* solution) {
  const Eigen::Index num_columns = differences.cols();
  DGSFM_CHECK(num_columns == 1 || num_columns == 3)
      << "differences of " << num_columns << " columns";
  const Eigen::MatrixXd right_side = Assemble(weights, differences);
  Eigen::MatrixXd unknowns(num_nodes_ - 1, num_columns);
  if (num_nodes_ > 1 &&
      (prefers_factorization_ ||
       !SolveByConjugateGradients(laplacian_, right_side, &unknowns)) &&
      !SolveByFactorization(right_side, &unknowns)) {
    return false;
  }
  solution->resize(num_nodes_, num_columns);
  solution->topRows(fixed_node_) = unknowns.topRows(fixed_node_);
  solution->row(fixed_node_).setZero();
  solution->bottomRows(num_nodes_ - 1 - fixed_node_) =
      unknowns.bottomRows(num_nodes_ - 1 - fixed_node_);
  return true;
}

Eigen::MatrixXd GraphLaplacianSolver::Assemble(
    const Eigen::VectorXd& weights, const Eigen::MatrixXd& differences) {
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
    if (entry.upper >= 0) {
      laplacian_.valuePtr()[entry.upper] -= weight;
      laplacian_.valuePtr()[entry.lower] -= weight;
    }
  }
  return right_side;
}

bool GraphLaplacianSolver::SolveByFactorization(
    const Eigen::MatrixXd& right_side, Eigen::MatrixXd* unknowns) {
  ldlt_.factorize(laplacian_);
  if (ldlt_.info() != Eigen::Success) return false;
  *unknowns = ldlt_.solve(right_side);
  return ldlt_.info() == Eigen::Success && unknowns->allFinite();
}

}  // namespace dgsfm
