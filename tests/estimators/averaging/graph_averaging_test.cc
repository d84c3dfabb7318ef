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

TEST(TrustInTriangles, GrowsWithTheirNumber) {
  EXPECT_EQ(TrustInTriangles({0, 1.5, 3, 9}), Eigen::Vector4d(0.1, 0.5, 1, 1));
}

// Places along a wall that repeats every 12 m: pairs of look-alikes claim the
// rest of their distance, and are as many as true pairs between the halves.
// They contradict each other, which triangles show.
TEST(AverageDifferences, LookAlikesThatCloseNoTrianglesDoNotFoldAWall) {
  constexpr int kNumNodes = 20;
  constexpr double kStep = 2;
  constexpr double kPeriod = 12;
  std::vector<GraphEdge> edges;
  for (int i = 0; i < kNumNodes; ++i) {
    for (int j = i + 1; j < std::min(i + 6, kNumNodes); ++j) {
      edges.emplace_back(i, j);
    }
  }
  const size_t num_true = edges.size();
  edges.insert(edges.end(),
               {{0, 14},
                {0, 17},
                {0, 19},
                {1, 11},
                {2, 14},
                {2, 15},
                {3, 11},
                {4, 12},
                {4, 14},
                {5, 13},
                {5, 15},
                {6, 19},
                {7, 16},
                {7, 19},
                {8, 16},
                {9, 19},
                {10, 18}});
  Eigen::MatrixXd differences(edges.size(), 1);
  Eigen::VectorXd stddevs(edges.size());
  for (size_t e = 0; e < edges.size(); ++e) {
    double distance = kStep * (edges[e].second - edges[e].first);
    if (e >= num_true) {
      distance -= kPeriod * std::round(distance / kPeriod);
    }
    differences(e, 0) = distance;
    stddevs(e) = 0.1 * std::max(std::abs(distance), 6.0);
  }
  Eigen::MatrixXd values;
  ASSERT_TRUE(AverageDifferences(
      kNumNodes, edges, differences, stddevs, /*fixed_node=*/0, {}, &values));
  for (int i = 0; i < kNumNodes; ++i) {
    // Exact but for outliers of 20 standard deviations, of weight 1e-9.
    EXPECT_NEAR(values(i, 0), kStep * i, 1e-6);
  }
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
