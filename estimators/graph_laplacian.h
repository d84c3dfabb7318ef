// Robust least squares over the differences across the edges of a graph: the
// structure that rotation and scale averaging share.

#pragma once

#include "estimators/graph.h"

#include <functional>
#include <vector>

#include <Eigen/CholmodSupport>
#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace dgsfm {

// Minimises sum_e w_e |x_2(e) - x_1(e) - b_e|^2 over rows x of a matrix with
// one row per node, gauge x = 0 at the fixed node: a weighted graph Laplacian
// without the row and column of that node. Its pattern is analysed once.
class GraphLaplacianSolver {
 public:
  // Throws on nodes out of range. Self-loops add nothing, parallel edges add
  // up; nodes that are not connected to fixed_node make Solve fail.
  GraphLaplacianSolver(int num_nodes,
                       const std::vector<GraphEdge>& edges,
                       int fixed_node);

  // weights: E, finite and positive. differences: E x K. solution: N x K.
  // CHOLMOD's supernodal factorisation, LDL^T where that fails. False,
  // solution unchanged, if both fail or the solution is not finite.
  [[nodiscard]] bool Solve(const Eigen::VectorXd& weights,
                           const Eigen::MatrixXd& differences,
                           Eigen::MatrixXd* solution);

 private:
  // Where an edge's weight goes among the values of the matrix; -1 for
  // entries of the fixed node.
  struct EdgeEntries {
    int row1 = -1;
    int row2 = -1;
    int diagonal1 = -1;
    int diagonal2 = -1;
    int off_diagonal = -1;
  };

  int num_nodes_;
  int fixed_node_;
  std::vector<EdgeEntries> entries_;
  Eigen::SparseMatrix<double> laplacian_;  // lower triangle
  Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>> cholesky_;
};

// One phase of iteratively reweighted least squares (IRLS).
struct ReweightingPhase {
  // Robust weight of a residual's norm.
  std::function<double(double norm)> robust_weight;
  int max_num_iterations = 0;
  // Mean norm of the nodes' steps below which the phase has converged.
  double step_convergence_threshold = 0;
};

// w(r) = 1 / max(r, floor), whose IRLS minimises the sum of norms (L1) but for
// residuals below the floor.
std::function<double(double)> L1Weight(double floor);

// w(r) = (s^2 / (s^2 + r^2))^2, the weight of the redescending Geman-McClure
// loss rho(r) = s^2 r^2 / (s^2 + r^2); w(0) = 1.
std::function<double(double)> GemanMcClureWeight(double scale);

// Runs a phase: weights the residuals (E x K, from compute_residuals, towards
// which the differences of the steps go), solves, hands the steps (N x K) to
// apply_steps. False if a factorisation fails.
[[nodiscard]] bool SolveReweighted(
    const ReweightingPhase& phase,
    const Eigen::VectorXd& edge_weights,
    const std::function<Eigen::MatrixXd()>& compute_residuals,
    const std::function<void(const Eigen::MatrixXd&)>& apply_steps,
    GraphLaplacianSolver* solver);

}  // namespace dgsfm
