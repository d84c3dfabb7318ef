// A preconditioner for the Laplacians of large weighted graphs.

#pragma once

#include "estimators/averaging/graph.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct WeightedEdges {
  std::vector<GraphEdge> edges;
  Eigen::VectorXd weights;
};

// A sample of the edges of a graph whose Laplacian is the graph's in
// expectation. The edges of a maximum spanning tree stay, others with a
// probability of 8 w (1 / d_1 + 1 / d_2), where d are sums of weights w at the
// ends, or one; those that stay stand for those that do not by their weight.
// Many weak edges between far nodes, which would fill factors in, become few.
// Deterministic: the draws have a fixed seed. weights: E, finite and positive.
WeightedEdges SampleEdges(int num_nodes,
                          const std::vector<GraphEdge>& edges,
                          const Eigen::VectorXd& weights);

// Sums of the weights of each node's edges, without self-loops: the diagonal of
// the Laplacian.
Eigen::VectorXd LaplacianDiagonal(int num_nodes,
                                  const std::vector<GraphEdge>& edges,
                                  const Eigen::VectorXd& weights);

// One row per node, one column, of one or three, per right side.
template <int kNumColumns>
using NodeVectors =
    Eigen::Matrix<double,
                  Eigen::Dynamic,
                  kNumColumns,
                  kNumColumns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

// An approximate factorisation of a connected graph's Laplacian whose size is
// that of the graph (Gao, Kyng and Spielman 2023, "Robust and practical
// solution of Laplacian equations by approximate elimination"). Elimination of
// a node joins all its neighbours; here a tree of edges that is right in
// expectation stands for these. With it, conjugate gradients take some dozen
// iterations, whatever the size of the graph and the range of its weights.
// Deterministic: the draws have a fixed seed. Memory: 12 bytes per edge, and 32
// more while it is made.
class ApproximateCholesky {
 public:
  // weights: E, finite and positive. Self-loops have no effect, parallel edges
  // add up. Throws on nodes out of range and on a graph that is not connected.
  ApproximateCholesky(int num_nodes,
                      const std::vector<GraphEdge>& edges,
                      const Eigen::VectorXd& weights);

  // Multiplies columns that sum to zero by the inverse of the factors; the
  // result's columns sum to zero.
  template <int kNumColumns>
  void Apply(NodeVectors<kNumColumns>* vectors) const;

 private:
  // Neighbours of a node when it was eliminated, the strongest last, with the
  // share of the remaining weight that goes to each.
  struct Step {
    int node = 0;
    double pivot = 0;
    size_t end = 0;  // of its neighbours
  };

  std::vector<Step> steps_;
  std::vector<int> neighbors_;
  std::vector<double> shares_;
};

}  // namespace dgsfm
