#include "estimators/averaging/graph.h"

#include <algorithm>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Edges between each pair of nodes with the given probability, no duplicates.
std::vector<GraphEdge> CreateRandomGraph(int num_nodes,
                                         double probability,
                                         std::mt19937* random) {
  std::bernoulli_distribution is_edge(probability);
  std::bernoulli_distribution is_swapped(0.5);
  std::vector<GraphEdge> edges;
  for (int i = 0; i < num_nodes; ++i) {
    for (int j = i + 1; j < num_nodes; ++j) {
      if (!is_edge(*random)) continue;
      edges.emplace_back(i, j);
      if (is_swapped(*random)) {
        std::swap(edges.back().first, edges.back().second);
      }
    }
  }
  std::shuffle(edges.begin(), edges.end(), *random);
  return edges;
}

TEST(ConnectedComponents, NumbersBySizeThenBySmallestNode) {
  // {1, 4, 6}, {0, 5}, {2, 3}, {7}.
  EXPECT_THAT(ConnectedComponents(8, {{5, 0}, {3, 2}, {6, 4}, {4, 1}}),
              ElementsAre(1, 0, 2, 2, 0, 1, 0, 3));
}

TEST(LargestComponent, HasItsNodesInOrder) {
  EXPECT_THAT(LargestComponent(8, {{5, 0}, {3, 2}, {6, 4}, {4, 1}}),
              ElementsAre(1, 4, 6));
  EXPECT_THAT(LargestComponent(0, {}), IsEmpty());
}

TEST(ConnectedComponents, EmptyGraphAndLoops) {
  EXPECT_THAT(ConnectedComponents(0, {}), IsEmpty());
  EXPECT_THAT(ConnectedComponents(2, {{1, 1}}), ElementsAre(0, 1));
}

TEST(ConnectedComponents, ThrowsOnNodesOutOfRange) {
  EXPECT_THROW(ConnectedComponents(2, {{0, 2}}), std::invalid_argument);
  EXPECT_THROW(ConnectedComponents(2, {{-1, 0}}), std::invalid_argument);
}

TEST(MaximumSpanningTree, TakesHeaviestEdgesAndOrdersParentsFirst) {
  const std::vector<GraphEdge> edges = {
      {0, 1}, {1, 2}, {2, 0}, {3, 2}, {3, 0}, {4, 5}};
  const SpanningTree tree =
      MaximumSpanningTree(6, edges, {1, 5, 4, 2, 3, 9}, 2);
  EXPECT_EQ(tree.root, 2);
  EXPECT_THAT(tree.parents, ElementsAre(2, 2, -1, 0, -1, -1));
  EXPECT_THAT(tree.parent_edges, ElementsAre(2, 1, -1, 4, -1, -1));
  EXPECT_THAT(tree.order, ElementsAre(2, 1, 0, 3));
}

TEST(MaximumSpanningTree, EarlierEdgeWinsAmongEqualWeights) {
  const std::vector<GraphEdge> edges = {{0, 1}, {0, 1}, {1, 2}, {2, 0}};
  const SpanningTree tree = MaximumSpanningTree(3, edges, {1, 1, 1, 1}, 0);
  EXPECT_THAT(tree.parent_edges, ElementsAre(-1, 0, 2));
}

TEST(MaximumSpanningTree, SingleNode) {
  const SpanningTree tree = MaximumSpanningTree(1, {}, {}, 0);
  EXPECT_THAT(tree.order, ElementsAre(0));
  EXPECT_THAT(tree.parents, ElementsAre(-1));
}

TEST(MaximumSpanningTree, ThrowsOnBadInput) {
  EXPECT_THROW(MaximumSpanningTree(2, {{0, 1}}, {1}, 2), std::invalid_argument);
  EXPECT_THROW(MaximumSpanningTree(2, {{0, 1}}, {}, 0), std::invalid_argument);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(MaximumSpanningTree(2, {{0, 1}}, {nan}, 0),
               std::invalid_argument);
}

TEST(VisitTriangles, VisitsEachOnceAsItsThreeEdges) {
  // Two triangles on the edge 1-2, a tail, a self-loop and a parallel edge.
  const std::vector<GraphEdge> edges = {
      {0, 1}, {2, 1}, {0, 2}, {1, 3}, {3, 2}, {4, 3}, {3, 3}, {4, 3}};
  std::set<std::set<int>> triangles;
  int num_visits = 0;
  VisitTriangles(5, edges, [&](int edge1, int edge2, int edge3) {
    triangles.insert({edge1, edge2, edge3});
    ++num_visits;
  });
  EXPECT_EQ(triangles, (std::set<std::set<int>>{{0, 1, 2}, {1, 3, 4}}));
  EXPECT_EQ(num_visits, 2);
}

TEST(TripletSupport, AveragesOverTrianglesOfTheEdge) {
  // Triangles 0-1-2 and 1-2-3; edge 3-4 is in none.
  const std::vector<GraphEdge> edges = {
      {0, 1}, {2, 1}, {0, 2}, {1, 3}, {3, 2}, {4, 3}};
  const std::vector<double> supports =
      TripletSupport(5, edges, {10, 20, 40, 80, 20, 7});
  // Ratios of powers of two, exact.
  EXPECT_THAT(supports, ElementsAre(0.25, (0.5 + 0.25) / 2, 1, 1, 0.25, -1));
}

TEST(TripletSupport, AgreesWithEnumerationOnRandomGraphs) {
  std::mt19937 random(1);
  for (const double probability : {0.05, 0.3, 1.0}) {
    const int num_nodes = 30;
    const auto edges = CreateRandomGraph(num_nodes, probability, &random);
    std::vector<double> counts(edges.size());
    std::vector<std::vector<int>> edge_of(num_nodes,
                                          std::vector<int>(num_nodes, -1));
    for (size_t e = 0; e < edges.size(); ++e) {
      counts[e] = std::uniform_int_distribution<>(1, 500)(random);
      edge_of[edges[e].first][edges[e].second] = e;
      edge_of[edges[e].second][edges[e].first] = e;
    }
    const std::vector<double> supports =
        TripletSupport(num_nodes, edges, counts);
    for (size_t e = 0; e < edges.size(); ++e) {
      double sum = 0;
      int num_triangles = 0;
      for (int k = 0; k < num_nodes; ++k) {
        const int e1 = edge_of[edges[e].first][k];
        const int e2 = edge_of[edges[e].second][k];
        if (e1 < 0 || e2 < 0) continue;
        sum += counts[e] / std::max({counts[e], counts[e1], counts[e2]});
        ++num_triangles;
      }
      // The two sums differ in their order alone.
      EXPECT_NEAR(
          supports[e], num_triangles > 0 ? sum / num_triangles : -1, 1e-12);
    }
  }
}

TEST(TripletSupport, ThrowsOnBadInput) {
  EXPECT_THROW(TripletSupport(2, {{0, 1}}, {}), std::invalid_argument);
  EXPECT_THROW(TripletSupport(2, {{0, 1}}, {0}), std::invalid_argument);
  EXPECT_THROW(TripletSupport(2, {{0, 0}}, {1}), std::invalid_argument);
  EXPECT_THROW(TripletSupport(2, {{0, 1}, {1, 0}}, {1, 1}),
               std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
