#include "estimators/averaging/graph_laplacian.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/check.h"

#include <algorithm>

namespace dgsfm {
namespace {

// Graphs of more nodes are not analysed, which takes longer than to solve them
// where the factors fill in.
constexpr int kMaxNumFactorizedNodes = 20000;

// Factorisations with more multiplications than this, some 0.1 s, are slower
// than conjugate gradients [1].
constexpr double kMaxNumMultiplications = 1e8;

// Residual of the linear system, relative to the right side, at which
// conjugate gradients stop [1]: reweighted least squares solves again for what
// is left.
constexpr double kResidualTolerance = 1e-4;

// Iterations of conjugate gradients, which take 10 to 60 with a new factor.
constexpr int kMaxNumIterations = 1000;

// Iterations that take as long as a new factor: a preconditioner that needs as
// many, or as many more than when it was new, gives way to one.
constexpr int kNumIterationsPerFactor = 60;

// Index among the values of a compressed matrix of an entry in its pattern.
int FindEntry(const Eigen::SparseMatrix<double>& matrix, int row, int col) {
  const int* rows = matrix.innerIndexPtr();
  const int* begin = rows + matrix.outerIndexPtr()[col];
  const int* end = rows + matrix.outerIndexPtr()[col + 1];
  return static_cast<int>(std::lower_bound(begin, end, row) - rows);
}

// Right side of the normal equations.
template <int kNumColumns>
NodeVectors<kNumColumns> RightSide(int num_nodes,
                                   const std::vector<GraphEdge>& edges,
                                   const Eigen::VectorXd& weights,
                                   const Eigen::MatrixXd& differences) {
  NodeVectors<kNumColumns> right_side =
      NodeVectors<kNumColumns>::Zero(num_nodes, kNumColumns);
  for (size_t e = 0; e < edges.size(); ++e) {
    right_side.row(edges[e].first) -= weights(e) * differences.row(e);
    right_side.row(edges[e].second) += weights(e) * differences.row(e);
  }
  return right_side;
}

template <int kNumColumns>
NodeVectors<kNumColumns> MultiplyByLaplacian(
    const std::vector<GraphEdge>& edges,
    const Eigen::VectorXd& weights,
    const NodeVectors<kNumColumns>& vectors) {
  NodeVectors<kNumColumns> product =
      NodeVectors<kNumColumns>::Zero(vectors.rows(), kNumColumns);
  for (size_t e = 0; e < edges.size(); ++e) {
    const auto [node1, node2] = edges[e];
    const Eigen::Matrix<double, 1, kNumColumns> change =
        weights(e) * (vectors.row(node2) - vectors.row(node1));
    product.row(node1) -= change;
    product.row(node2) += change;
  }
  return product;
}

template <int kNumColumns>
using ColumnArray = Eigen::Array<double, kNumColumns, 1>;

template <int kNumColumns>
ColumnArray<kNumColumns> ColumnDots(const NodeVectors<kNumColumns>& a,
                                    const NodeVectors<kNumColumns>& b) {
  return a.cwiseProduct(b).colwise().sum().transpose();
}

// Conjugate gradients for each column, with the whole Laplacian, whose null
// space are the constants: without the fixed node it is badly conditioned, for
// few edges hold that node against all others. The values start as they are.
// Returns the iterations taken, nothing without convergence.
template <int kNumColumns, typename Preconditioner>
std::optional<int> SolveByConjugateGradients(
    const std::vector<GraphEdge>& edges,
    const Eigen::VectorXd& weights,
    const NodeVectors<kNumColumns>& right_side,
    const Preconditioner& precondition,
    int max_num_iterations,
    NodeVectors<kNumColumns>* values) {
  const ColumnArray<kNumColumns> max_sq_norms =
      kResidualTolerance * kResidualTolerance *
      ColumnDots(right_side, right_side);
  NodeVectors<kNumColumns> residuals =
      right_side - MultiplyByLaplacian(edges, weights, *values);
  NodeVectors<kNumColumns> directions;
  ColumnArray<kNumColumns> products;
  for (int i = 0; i < max_num_iterations; ++i) {
    ThrowIfCancelled();
    if ((ColumnDots(residuals, residuals) <= max_sq_norms).all()) return i;
    NodeVectors<kNumColumns> steps = residuals;
    precondition(&steps);
    const ColumnArray<kNumColumns> previous_products = products;
    products = ColumnDots(residuals, steps);
    if (i == 0) {
      directions = std::move(steps);
    } else {
      // Columns that are solved exactly stay.
      const ColumnArray<kNumColumns> ratios =
          (previous_products > 0).select(products / previous_products, 0.0);
      directions = steps + directions * ratios.matrix().asDiagonal();
    }
    const NodeVectors<kNumColumns> changes =
        MultiplyByLaplacian(edges, weights, directions);
    const ColumnArray<kNumColumns> curvatures = ColumnDots(directions, changes);
    const ColumnArray<kNumColumns> lengths =
        (curvatures > 0).select(products / curvatures, 0.0);
    *values += directions * lengths.matrix().asDiagonal();
    residuals -= changes * lengths.matrix().asDiagonal();
  }
  return std::nullopt;
}

}  // namespace

GraphLaplacianSolver::GraphLaplacianSolver(int num_nodes,
                                           const std::vector<GraphEdge>& edges,
                                           int fixed_node)
    : num_nodes_(num_nodes), fixed_node_(fixed_node), edges_(edges) {
  DGSFM_CHECK(fixed_node >= 0 && fixed_node < num_nodes)
      << "fixed_node = " << fixed_node << " of " << num_nodes;
  for (const int component : ConnectedComponents(num_nodes, edges)) {
    is_connected_ = is_connected_ && component == 0;
  }
  if (num_nodes == 1 || num_nodes > kMaxNumFactorizedNodes) return;
  AnalyzePattern();
  is_factorized_ = ldlt_.NumMultiplications() <= kMaxNumMultiplications;
}

bool GraphLaplacianSolver::Solve(const Eigen::VectorXd& weights,
                                 const Eigen::MatrixXd& differences,
                                 Eigen::MatrixXd* solution) {
  const auto num_edges = static_cast<Eigen::Index>(edges_.size());
  DGSFM_CHECK(weights.size() == num_edges && differences.rows() == num_edges);
  const Eigen::Index num_columns = differences.cols();
  DGSFM_CHECK(num_columns == 1 || num_columns == 3)
      << "differences of " << num_columns << " columns";
  return num_columns == 1 ? SolveColumns<1>(weights, differences, solution)
                          : SolveColumns<3>(weights, differences, solution);
}

template <int kNumColumns>
bool GraphLaplacianSolver::SolveColumns(const Eigen::VectorXd& weights,
                                        const Eigen::MatrixXd& differences,
                                        Eigen::MatrixXd* solution) {
  if (!is_connected_) return false;
  auto values =
      RightSide<kNumColumns>(num_nodes_, edges_, weights, differences);
  if (num_nodes_ > 1 &&
      !(is_factorized_ ? SolveByFactorization(weights, &values)
                       : SolveByIterations(weights, &values))) {
    return false;
  }
  if (!values.allFinite()) return false;
  *solution = values.rowwise() - values.row(fixed_node_).eval();
  return true;
}

int GraphLaplacianSolver::RowOf(int node) const {
  return node == fixed_node_ ? -1 : node - (node > fixed_node_ ? 1 : 0);
}

void GraphLaplacianSolver::AnalyzePattern() {
  std::vector<Eigen::Triplet<double>> pattern;
  for (int row = 0; row < num_nodes_ - 1; ++row) {
    pattern.emplace_back(row, row, 1);
  }
  for (const auto& [node1, node2] : edges_) {
    const int row1 = RowOf(node1);
    const int row2 = RowOf(node2);
    if (row1 < 0 || row2 < 0 || row1 == row2) continue;
    pattern.emplace_back(row1, row2, 0);
    pattern.emplace_back(row2, row1, 0);
  }
  laplacian_.resize(num_nodes_ - 1, num_nodes_ - 1);
  laplacian_.setFromTriplets(pattern.begin(), pattern.end());
  ldlt_.analyzePattern(laplacian_);
}

void GraphLaplacianSolver::FillIn(const Eigen::VectorXd& weights) {
  std::fill_n(laplacian_.valuePtr(), laplacian_.nonZeros(), 0.0);
  const auto add = [&](int row, int col, double value) {
    if (row >= 0 && col >= 0) {
      laplacian_.valuePtr()[FindEntry(laplacian_, row, col)] += value;
    }
  };
  for (size_t e = 0; e < edges_.size(); ++e) {
    const int row1 = RowOf(edges_[e].first);
    const int row2 = RowOf(edges_[e].second);
    if (row1 == row2) continue;
    add(row1, row1, weights(e));
    add(row2, row2, weights(e));
    add(row1, row2, -weights(e));
    add(row2, row1, -weights(e));
  }
}

template <int kNumColumns>
bool GraphLaplacianSolver::SolveByFactorization(
    const Eigen::VectorXd& weights, NodeVectors<kNumColumns>* values) {
  FillIn(weights);
  ldlt_.factorize(laplacian_);
  if (ldlt_.info() != Eigen::Success) return false;
  const Eigen::Index num_below = num_nodes_ - 1 - fixed_node_;
  Eigen::MatrixXd unknowns(num_nodes_ - 1, kNumColumns);
  unknowns << values->topRows(fixed_node_), values->bottomRows(num_below);
  unknowns = ldlt_.solve(unknowns).eval();
  values->topRows(fixed_node_) = unknowns.topRows(fixed_node_);
  values->row(fixed_node_).setZero();
  values->bottomRows(num_below) = unknowns.bottomRows(num_below);
  return ldlt_.info() == Eigen::Success;
}

template <int kNumColumns>
bool GraphLaplacianSolver::SolveByIterations(const Eigen::VectorXd& weights,
                                             NodeVectors<kNumColumns>* values) {
  Eigen::VectorXd diagonal;
  if (!factor_) diagonal = LaplacianDiagonal(num_nodes_, edges_, weights);
  const auto precondition = [&](NodeVectors<kNumColumns>* vectors) {
    if (factor_) {
      factor_->Apply(vectors);
    } else {
      vectors->array().colwise() /= diagonal.array();
    }
  };
  const NodeVectors<kNumColumns> right_side = std::move(*values);
  *values = NodeVectors<kNumColumns>::Zero(num_nodes_, kNumColumns);
  const auto solve = [&](int max_num_iterations) {
    const std::optional<int> num_iterations = SolveByConjugateGradients(
        edges_, weights, right_side, precondition, max_num_iterations, values);
    if (num_iterations) preconditioner_wear_.Add(*num_iterations);
    return num_iterations.has_value();
  };
  if (preconditioner_wear_.num_extra_iterations < kNumIterationsPerFactor &&
      solve(kNumIterationsPerFactor)) {
    return true;
  }
  const WeightedEdges sample = SampleEdges(num_nodes_, edges_, weights);
  factor_.emplace(num_nodes_, sample.edges, sample.weights);
  preconditioner_wear_ = {};
  return solve(kMaxNumIterations);
}

void GraphLaplacianSolver::PreconditionerWear::Add(int num_iterations) {
  fewest_iterations = std::min(fewest_iterations, num_iterations);
  num_extra_iterations += num_iterations - fewest_iterations;
}

}  // namespace dgsfm
