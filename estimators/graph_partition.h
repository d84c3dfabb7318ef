// A graph in overlapping parts that fit into memory.

#pragma once

#include "estimators/averaging/graph.h"

#include <string>
#include <vector>

namespace dgsfm {

struct GraphPartitionOptions {
  // Sum of the sizes of the nodes of a part, at most.
  int max_part_size = 1000;
  // Share of that which a part may take from its neighbours, so that they have
  // nodes in common.
  double overlap = 0.2;

  bool IsValid(std::string* error) const;
};

// Parts of the nodes, each sorted, ordered by their first node. Connected
// components that are small enough stay whole, several to a part where they
// fit; larger ones are cut by METIS into connected cores so that little weight
// is cut (Karypis and Kumar 1998), to which nodes of neighbours are added,
// from each neighbour in turn those that most weight joins to the part. Each
// node is in the core of one part. A node larger than a part is a part of its
// own. Sizes and weights are positive integers. Deterministic. Throws on nodes
// out of range, and std::runtime_error if METIS fails.
std::vector<std::vector<int>> PartitionGraph(
    const GraphPartitionOptions& options,
    const std::vector<int>& node_sizes,
    const std::vector<GraphEdge>& edges,
    const std::vector<int>& weights);

}  // namespace dgsfm
