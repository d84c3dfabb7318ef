#include "estimators/averaging/graph_averaging.h"

#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A ring with chords, so that each node has four edges.
std::vector<GraphEdge> RingEdges(int num_nodes) {
  std::vector<GraphEdge> edges;
  for (int i = 0; i < num_nodes; ++i) {
    edges.emplace_back(i, (i + 1) % num_nodes);
    edges.emplace_back(i, (i + 3) % num_nodes);
  }
  return edges;
}

Eigen::MatrixXd Differences(const std::vector<GraphEdge>& edges,
                            const Eigen::MatrixXd& values) {
  Eigen::MatrixXd differences(edges.size(), values.cols());
  for (size_t e = 0; e < edges.size(); ++e) {
    differences.row(Eigen::Index(e)) =
        values.row(edges[e].second) - values.row(edges[e].first);
  }
  return differences;
}

TEST(Weights, FallWithTheResidual) {
  EXPECT_EQ(L1Weight(0.1)(0.01), 10);
  EXPECT_EQ(L1Weight(0.1)(2), 0.5);
  EXPECT_EQ(GemanMcClureWeight(2)(0), 1);
  EXPECT_EQ(GemanMcClureWeight(2)(2), 0.25);
}

// The tail of the loss pulls on the side that a false edge agrees with: enough
// such edges would tear a large graph apart.
TEST(Weights, FarResidualsHaveNoInfluence) {
  EXPECT_NEAR(GemanMcClureWeight(2)(9.99), 1.5e-3, 1e-4);
  EXPECT_LE(GemanMcClureWeight(2)(10.01), 1e-9);
  EXPECT_GT(GemanMcClureWeight(2)(1e9), 0);
}

TEST(AverageDifferences, IgnoresOutliers) {
  constexpr int kNumNodes = 12;
  const std::vector<GraphEdge> edges = RingEdges(kNumNodes);
  Eigen::MatrixXd truth(kNumNodes, 3);
  for (int i = 0; i < kNumNodes; ++i) truth.row(i) << i, i * i, -i;
  truth.rowwise() -= truth.row(4).eval();
  Eigen::MatrixXd differences = Differences(edges, truth);
  // Two of 24 edges, at different nodes.
  differences.row(3) << 50, -50, 0;
  differences.row(14) << -20, 90, 9;
  Eigen::MatrixXd values;
  ASSERT_TRUE(AverageDifferences(kNumNodes,
                                 edges,
                                 differences,
                                 Eigen::VectorXd::Constant(24, 0.1),
                                 /*fixed_node=*/4,
                                 {},
                                 &values));
  // Outliers of 500 standard deviations keep a weight of 1e-9.
  EXPECT_LT((values - truth).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_EQ(values.row(4).norm(), 0);
}

TEST(AverageDifferences, FailsWhereTheGraphIsNotConnected) {
  Eigen::MatrixXd values = Eigen::MatrixXd::Constant(4, 1, 7);
  EXPECT_FALSE(AverageDifferences(4,
                                  {{0, 1}, {2, 3}},
                                  Eigen::MatrixXd::Zero(2, 1),
                                  Eigen::VectorXd::Ones(2),
                                  0,
                                  {},
                                  &values));
  EXPECT_EQ(values, Eigen::MatrixXd::Constant(4, 1, 7));
}

TEST(AverageDifferences, ThrowsOnBadInput) {
  const auto average = [](double difference, double stddev, int fixed_node) {
    Eigen::MatrixXd values;
    return AverageDifferences(2,
                              {{0, 1}},
                              Eigen::MatrixXd::Constant(1, 1, difference),
                              Eigen::VectorXd::Constant(1, stddev),
                              fixed_node,
                              {},
                              &values);
  };
  EXPECT_TRUE(average(1, 1, 0));
  EXPECT_THROW(average(std::numeric_limits<double>::quiet_NaN(), 1, 0),
               std::invalid_argument);
  EXPECT_THROW(average(1, 0, 0), std::invalid_argument);
  EXPECT_THROW(average(1, 1, 2), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
