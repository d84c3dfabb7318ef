#include "estimators/averaging/approximate_cholesky.h"

#include "tests/estimators/averaging_graph.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct WeightedGraph {
  int num_nodes = 0;
  std::vector<GraphEdge> edges;
  Eigen::VectorXd weights;
};

// Weights over eight orders of magnitude, as robust losses give them.
WeightedGraph CreateGraph(GraphLayout layout, int num_nodes, int num_edges) {
  std::mt19937 random(1);
  WeightedGraph graph;
  graph.num_nodes = num_nodes;
  graph.edges = LayoutEdges(layout, num_nodes, num_edges, &random);
  std::uniform_real_distribution<double> exponent(-4, 4);
  graph.weights.resize(num_edges);
  for (double& weight : graph.weights) weight = std::pow(10, exponent(random));
  return graph;
}

NodeVectors<1> ZeroMeanVector(int num_nodes, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  NodeVectors<1> vector(num_nodes);
  for (double& value : vector) value = normal(random);
  return vector.array() - vector.mean();
}

NodeVectors<1> MultiplyByLaplacian(const WeightedGraph& graph,
                                   const NodeVectors<1>& vector) {
  NodeVectors<1> product = NodeVectors<1>::Zero(graph.num_nodes);
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    const auto [node1, node2] = graph.edges[e];
    const double change = graph.weights(e) * (vector(node2) - vector(node1));
    product(node1) -= change;
    product(node2) += change;
  }
  return product;
}

// A tree has nothing to draw: the factors are exact.
TEST(ApproximateCholesky, IsTheInverseOfATree) {
  const WeightedGraph tree = CreateGraph(GraphLayout::RANDOM, 100, 99);
  const NodeVectors<1> truth = ZeroMeanVector(100, 2);
  NodeVectors<1> vector = MultiplyByLaplacian(tree, truth);
  ApproximateCholesky(100, tree.edges, tree.weights).Apply(&vector);
  // Rounding, times the range of the weights.
  EXPECT_LT((vector - truth).norm(), 1e-6 * truth.norm());
}

// Each node of a cycle is eliminated exactly, too: two neighbours, one draw.
TEST(ApproximateCholesky, IsTheInverseOfACycleWithParallelEdgesAndSelfLoops) {
  WeightedGraph cycle;
  cycle.num_nodes = 4;
  cycle.edges = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {1, 0}, {2, 2}};
  cycle.weights.resize(6);
  cycle.weights << 1, 2, 3, 4, 5, 6;
  const NodeVectors<1> truth = ZeroMeanVector(4, 2);
  NodeVectors<1> vector = MultiplyByLaplacian(cycle, truth);
  ApproximateCholesky(4, cycle.edges, cycle.weights).Apply(&vector);
  EXPECT_LT((vector - truth).norm(), 1e-12 * truth.norm());  // rounding
}

// Conjugate gradients need a symmetric, positive definite preconditioner.
TEST(ApproximateCholesky, IsSymmetricAndPositive) {
  const WeightedGraph graph = CreateGraph(GraphLayout::CITY, 400, 3000);
  const ApproximateCholesky factor(400, graph.edges, graph.weights);
  const NodeVectors<1> a = ZeroMeanVector(400, 1);
  const NodeVectors<1> b = ZeroMeanVector(400, 2);
  NodeVectors<1> inverse_a = a;
  NodeVectors<1> inverse_b = b;
  factor.Apply(&inverse_a);
  factor.Apply(&inverse_b);
  EXPECT_GT(a.dot(inverse_a), 0);
  EXPECT_NEAR(a.dot(inverse_b),
              b.dot(inverse_a),
              1e-10 * a.norm() * inverse_b.norm());  // rounding
}

// The largest eigenvalue of the product with the Laplacian, by the power
// method.
TEST(ApproximateCholesky, ComesNearTheInverse) {
  for (const GraphLayout layout :
       {GraphLayout::STREET, GraphLayout::CITY, GraphLayout::RANDOM}) {
    const WeightedGraph graph = CreateGraph(layout, 2000, 20000);
    const ApproximateCholesky factor(2000, graph.edges, graph.weights);
    NodeVectors<1> vector = ZeroMeanVector(2000, 3);
    double eigenvalue = 0;
    for (int i = 0; i < 50; ++i) {
      vector = MultiplyByLaplacian(graph, vector.normalized().eval());
      factor.Apply(&vector);
      eigenvalue = vector.norm();
    }
    // An exact inverse has one; 7.3, 2.6 and 3.0 were measured.
    EXPECT_LT(eigenvalue, 20);
  }
}

TEST(SampleEdges, KeepsATreeAndWhatNodesDependOnAndTheSumOfTheRest) {
  // A wheel of strong edges, and a weak edge between any two nodes.
  constexpr int kNumNodes = 400;
  std::vector<GraphEdge> edges;
  for (int i = 0; i < kNumNodes; ++i) {
    edges.emplace_back(i, (i + 1) % kNumNodes);
  }
  for (int i = 0; i < kNumNodes; ++i) {
    for (int j = 0; j < i; ++j) edges.emplace_back(i, j);
  }
  Eigen::VectorXd weights = Eigen::VectorXd::Constant(edges.size(), 1e-4);
  weights.head(kNumNodes).setOnes();
  const WeightedEdges sample = SampleEdges(kNumNodes, edges, weights);
  ASSERT_GT(sample.edges.size(), size_t(kNumNodes));
  EXPECT_TRUE(std::equal(
      edges.begin(), edges.begin() + kNumNodes, sample.edges.begin()));
  EXPECT_TRUE(sample.weights.head(kNumNodes).isOnes(0));
  // 8 * 1e-4 * 2 / 2.04 of the 79,800 weak edges, 63, whose number has a
  // standard deviation of 8; their weights have the sum of all within as much.
  const Eigen::Index num_weak = sample.weights.size() - kNumNodes;
  EXPECT_NEAR(num_weak, 63, 24);
  EXPECT_NEAR(sample.weights.tail(num_weak).sum(), 7.98, 3);
}

TEST(ApproximateCholesky, ColumnsAreIndependentAndBitsRepeat) {
  const WeightedGraph graph = CreateGraph(GraphLayout::CITY, 400, 3000);
  NodeVectors<3> vectors(400, 3);
  for (int c = 0; c < 3; ++c) vectors.col(c) = ZeroMeanVector(400, c);
  ApproximateCholesky(400, graph.edges, graph.weights).Apply(&vectors);
  for (int c = 0; c < 3; ++c) {
    NodeVectors<1> vector = ZeroMeanVector(400, c);
    NodeVectors<1> again = vector;
    ApproximateCholesky(400, graph.edges, graph.weights).Apply(&vector);
    ApproximateCholesky(400, graph.edges, graph.weights).Apply(&again);
    EXPECT_EQ(vector, again);
    // Means of columns are sums in another order.
    EXPECT_LT((vectors.col(c) - vector).norm(), 1e-12 * vector.norm());
  }
}

TEST(ApproximateCholesky, ThrowsOnBrokenInput) {
  const Eigen::VectorXd weights = Eigen::VectorXd::Ones(1);
  EXPECT_THROW(ApproximateCholesky(2, {{0, 2}}, weights),
               std::invalid_argument);
  EXPECT_THROW(ApproximateCholesky(3, {{0, 1}}, weights),
               std::invalid_argument);
  EXPECT_THROW(ApproximateCholesky(2, {{0, 1}, {0, 1}}, weights),
               std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
