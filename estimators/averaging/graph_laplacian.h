// Least squares over the differences across the edges of a graph: the linear
// system that the averages of rotations, scales and translations share.

#pragma once

#include "estimators/averaging/approximate_cholesky.h"

#include <limits>
#include <optional>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

namespace dgsfm {

// Minimises sum_e w_e |x_2(e) - x_1(e) - b_e|^2 over rows x of a matrix with
// one row per node, gauge x = 0 at the fixed node: a weighted graph Laplacian
// without the row and column of that node.
//
// Its pattern is analysed once. Where the factors would fill in, as the many
// edges between far nodes of a large graph make them, conjugate gradients with
// ApproximateCholesky take the place of LDL^T. Single-threaded, without BLAS:
// the same bits everywhere.
class GraphLaplacianSolver {
 public:
  // Throws on nodes out of range. Self-loops add nothing, parallel edges add
  // up; nodes that are not connected to fixed_node make Solve fail.
  GraphLaplacianSolver(int num_nodes,
                       const std::vector<GraphEdge>& edges,
                       int fixed_node);

  // weights: E, finite and positive. differences: E x K, K one or three.
  // solution: N x K.
  // False, solution unchanged, if nodes are not connected, a factorisation
  // fails, conjugate gradients do not converge or the solution is not finite.
  [[nodiscard]] bool Solve(const Eigen::VectorXd& weights,
                           const Eigen::MatrixXd& differences,
                           Eigen::MatrixXd* solution);

 private:
  using SparseMatrix = Eigen::SparseMatrix<double>;

  class Ldlt : public Eigen::SimplicialLDLT<SparseMatrix> {
   public:
    // Multiplications of a factorisation, known from the analysis.
    double NumMultiplications() const {
      return m_nonZerosPerCol.cast<double>().squaredNorm();
    }
  };

  // Iterations beyond those of its best solution, since a preconditioner is
  // new.
  struct PreconditionerWear {
    int fewest_iterations = std::numeric_limits<int>::max();
    int num_extra_iterations = 0;
    void Add(int num_iterations);
  };

  // Row of a node in the system without the fixed node; -1 for that one.
  int RowOf(int node) const;
  void AnalyzePattern();
  void FillIn(const Eigen::VectorXd& weights);
  template <int kNumColumns>
  bool SolveColumns(const Eigen::VectorXd& weights,
                    const Eigen::MatrixXd& differences,
                    Eigen::MatrixXd* solution);
  // The values are the right side, afterwards the solution.
  template <int kNumColumns>
  bool SolveByFactorization(const Eigen::VectorXd& weights,
                            NodeVectors<kNumColumns>* values);
  template <int kNumColumns>
  bool SolveByIterations(const Eigen::VectorXd& weights,
                         NodeVectors<kNumColumns>* values);

  int num_nodes_;
  int fixed_node_;
  std::vector<GraphEdge> edges_;
  bool is_connected_ = true;
  SparseMatrix laplacian_;  // both triangles
  Ldlt ldlt_;
  bool is_factorized_ = false;
  // The preconditioner of conjugate gradients, the diagonal if there is none:
  // of an earlier solution's weights, which the next ones resemble.
  std::optional<ApproximateCholesky> factor_;
  PreconditionerWear preconditioner_wear_;
};

}  // namespace dgsfm
