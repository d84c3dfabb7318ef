// Least squares over the differences across the edges of a graph: the linear
// system that the averages of rotations, scales and translations share.

#pragma once

#include "estimators/averaging/graph.h"

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
// edges between far nodes of a large graph make them, conjugate gradients
// preconditioned by the diagonal take the place of LDL^T: such graphs are well
// conditioned. Single-threaded, without BLAS: the same bits everywhere.
class GraphLaplacianSolver {
 public:
  // Throws on nodes out of range. Self-loops add nothing, parallel edges add
  // up; nodes that are not connected to fixed_node make Solve fail.
  GraphLaplacianSolver(int num_nodes,
                       const std::vector<GraphEdge>& edges,
                       int fixed_node);

  // weights: E, finite and positive. differences: E x K, K one or three.
  // solution: N x K.
  // Conjugate gradients that do not converge give way to LDL^T. False,
  // solution unchanged, if that fails or the solution is not finite.
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

  // Where an edge's weight goes among the values of the matrix; -1 for
  // entries of the fixed node.
  struct EdgeEntries {
    int row1 = -1;
    int row2 = -1;
    int diagonal1 = -1;
    int diagonal2 = -1;
    int upper = -1;
    int lower = -1;
  };

  // Returns the right side of the normal equations, N - 1 x K.
  Eigen::MatrixXd Assemble(const Eigen::VectorXd& weights,
                           const Eigen::MatrixXd& differences);
  bool SolveByFactorization(const Eigen::MatrixXd& right_side,
                            Eigen::MatrixXd* unknowns);

  int num_nodes_;
  int fixed_node_;
  std::vector<EdgeEntries> entries_;
  SparseMatrix laplacian_;  // both triangles
  Ldlt ldlt_;
  bool prefers_factorization_ = true;
};

}  // namespace dgsfm
