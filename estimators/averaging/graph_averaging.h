// Robust averages over the edges of a graph by iteratively reweighted least
// squares (IRLS): what the averages of rotations, scales and translations
// share.

#pragma once

#include "estimators/averaging/graph.h"
#include "estimators/averaging/graph_laplacian.h"

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct GraphAveragingOptions {
  // Steps of the L1 phase, which has to undo outlier edges in the start, and
  // of the phase with a redescending loss.
  int max_num_l1_iterations = 50;
  int max_num_irls_iterations = 100;
  // Scale of the redescending loss [standard deviations of an edge].
  double loss_scale = 3.0;
  // Mean change of the edges' residuals below which the last phase has
  // converged [standard deviations]; the L1 phase stops at 0.1.
  double convergence_threshold = 1e-3;

  bool IsValid(std::string* error) const;
};

// w(r) = 1 / max(r, floor), whose IRLS minimises the sum of norms (L1) but for
// residuals below the floor.
std::function<double(double)> L1Weight(double floor);

// w(r) = (s^2 / (s^2 + r^2))^2, the weight of the redescending Geman-McClure
// loss rho(r) = s^2 r^2 / (s^2 + r^2); w(0) = 1. Beyond 5 s it is 1e-9: rho is
// constant there.
std::function<double(double)> GemanMcClureWeight(double scale);

// Trust of edges in the L1 phase by the number of triangles that they close, in
// [0.1, 1]: an edge that closes none is either false or has too few neighbours
// to be tested.
Eigen::VectorXd TrustInTriangles(
    const std::vector<double>& num_closing_triangles);

// Minimises sum_e weight_e rho(|r_e| / stddev_e) over the nodes, first with
// rho(x) = x, times l1_trust_e > 0, then with the Geman-McClure loss, which
// needs a start free of most outliers. compute_residuals gives the
// residuals r (E x K), towards which the differences x_2 - x_1 of the steps
// go; apply_steps takes the steps x (N x K, zero at the fixed node of the
// solver). False if the linear solver fails.
[[nodiscard]] bool AverageReweighted(
    const GraphAveragingOptions& options,
    const std::vector<GraphEdge>& edges,
    const Eigen::VectorXd& stddevs,
    const Eigen::VectorXd& weights,
    const Eigen::VectorXd& l1_trust,
    const std::function<Eigen::MatrixXd()>& compute_residuals,
    const std::function<void(const Eigen::MatrixXd&)>& apply_steps,
    GraphLaplacianSolver* solver);

// Values (N x K) of all nodes of a connected graph from their differences
// x_2 - x_1 across the edges (E x K), gauge: zero at fixed_node. Least squares
// is the start of AverageReweighted, whose L1 phase trusts edges by the
// triangles that they close. Returns false, values unchanged, if the graph is
// not connected or the linear solver fails. Throws on differences that are not
// finite, standard deviations that are not finite and positive, and nodes out
// of range.
[[nodiscard]] bool AverageDifferences(int num_nodes,
                                      const std::vector<GraphEdge>& edges,
                                      const Eigen::MatrixXd& differences,
                                      const Eigen::VectorXd& stddevs,
                                      int fixed_node,
                                      const GraphAveragingOptions& options,
                                      Eigen::MatrixXd* values);

// Throws on standard deviations that are not finite and positive.
void CheckStddevs(const Eigen::VectorXd& stddevs);

}  // namespace dgsfm
