#include "estimators/graph_partition.h"

#include <algorithm>
#include <numeric>
#include <set>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct TestGraph {
  std::vector<int> sizes;
  std::vector<GraphEdge> edges;
  std::vector<int> weights;
};

// Nodes in a row, each joined with the next `reach`, the nearest most.
void AddChain(int num_nodes, int reach, TestGraph* graph) {
  const int first = int(graph->sizes.size());
  graph->sizes.resize(first + num_nodes, 1);
  for (int i = 0; i < num_nodes; ++i) {
    for (int j = i + 1; j < std::min(num_nodes, i + 1 + reach); ++j) {
      graph->edges.emplace_back(first + i, first + j);
      graph->weights.push_back(100 / (j - i));
    }
  }
}

std::vector<std::vector<int>> Partition(const GraphPartitionOptions& options,
                                        const TestGraph& graph) {
  return PartitionGraph(options, graph.sizes, graph.edges, graph.weights);
}

// Every node is in a part, and no part is too large.
void ExpectCover(const GraphPartitionOptions& options,
                 const TestGraph& graph,
                 const std::vector<std::vector<int>>& parts) {
  std::set<int> covered;
  for (const auto& part : parts) {
    EXPECT_TRUE(std::is_sorted(part.begin(), part.end()));
    int size = 0;
    for (const int node : part) size += graph.sizes[node];
    EXPECT_LE(size, options.max_part_size);
    covered.insert(part.begin(), part.end());
  }
  EXPECT_EQ(covered.size(), graph.sizes.size());
}

TEST(PartitionGraph, CutsAChainIntoOverlappingRanges) {
  GraphPartitionOptions options;
  options.max_part_size = 250;
  TestGraph graph;
  AddChain(1000, 8, &graph);
  const auto parts = Partition(options, graph);
  ExpectCover(options, graph, parts);
  EXPECT_LE(parts.size(), 7);
  for (size_t i = 0; i < parts.size(); ++i) {
    // Ranges, of which those inside take 25 nodes on either side.
    EXPECT_EQ(parts[i].back() - parts[i].front() + 1, int(parts[i].size()));
    if (i == 0) continue;
    EXPECT_GE(parts[i - 1].back() - parts[i].front() + 1, 40);
  }
  EXPECT_EQ(Partition(options, graph), parts);
}

TEST(PartitionGraph, WithoutOverlapPartsShareNothing) {
  GraphPartitionOptions options;
  options.max_part_size = 100;
  options.overlap = 0;
  TestGraph graph;
  AddChain(730, 5, &graph);
  const auto parts = Partition(options, graph);
  ExpectCover(options, graph, parts);
  size_t num_nodes = 0;
  for (const auto& part : parts) num_nodes += part.size();
  EXPECT_EQ(num_nodes, graph.sizes.size());
}

TEST(PartitionGraph, CutsWhereLittleWeightIsCut) {
  GraphPartitionOptions options;
  options.max_part_size = 100;
  options.overlap = 0;
  TestGraph graph;
  // Two places, joined by a weak edge that is not in the middle of the ids.
  AddChain(82, 20, &graph);
  AddChain(78, 20, &graph);
  graph.edges.emplace_back(3, 95);
  graph.weights.push_back(1);
  const auto parts = Partition(options, graph);
  ASSERT_EQ(parts.size(), 2);
  EXPECT_EQ(parts[0].size(), 82);
  EXPECT_EQ(parts[0].back(), 81);
}

TEST(PartitionGraph, SmallComponentsShareParts) {
  GraphPartitionOptions options;
  options.max_part_size = 50;
  TestGraph graph;
  for (int i = 0; i < 10; ++i) AddChain(12, 3, &graph);
  AddChain(1, 1, &graph);
  const auto parts = Partition(options, graph);
  ExpectCover(options, graph, parts);
  EXPECT_EQ(parts.size(), 3);
}

TEST(PartitionGraph, HoldsSizesOfNodes) {
  GraphPartitionOptions options;
  options.max_part_size = 60;
  TestGraph graph;
  AddChain(100, 4, &graph);
  for (size_t i = 0; i < graph.sizes.size(); ++i) {
    graph.sizes[i] = 1 + int(i % 6);
  }
  ExpectCover(options, graph, Partition(options, graph));
}

}  // namespace
}  // namespace dgsfm
