#include "estimators/graph_partition.h"

#include "colmap_ext/check.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>

#include <metis.h>

namespace dgsfm {

namespace {

using Nodes = std::vector<int>;

// Share by which METIS may exceed the mean size of a part.
constexpr double kMaxImbalance = 0.05;

// Neighbours of each node with the weights of the edges, parallel ones summed.
using Neighbors = std::vector<std::map<int, int>>;

Neighbors NeighborsOf(size_t num_nodes,
                      const std::vector<GraphEdge>& edges,
                      const std::vector<int>& weights) {
  Neighbors neighbors(num_nodes);
  for (size_t i = 0; i < edges.size(); ++i) {
    const auto [node1, node2] = edges[i];
    DGSFM_CHECK(weights[i] > 0) << weights[i];
    if (node1 == node2) continue;
    neighbors.at(node1)[node2] += weights[i];
    neighbors.at(node2)[node1] += weights[i];
  }
  return neighbors;
}

int SizeOf(const Nodes& nodes, const std::vector<int>& sizes) {
  int size = 0;
  for (const int node : nodes) size += sizes[node];
  return size;
}

// The graph of a connected component as METIS takes it.
struct MetisGraph {
  std::vector<idx_t> begins{0}, ends, edge_weights, node_sizes;
};

MetisGraph MetisGraphOf(const Nodes& nodes,
                        const std::vector<int>& sizes,
                        const Neighbors& neighbors) {
  std::map<int, idx_t> index;
  for (const int node : nodes) index.emplace(node, idx_t(index.size()));
  MetisGraph graph;
  for (const int node : nodes) {
    for (const auto& [other, weight] : neighbors[node]) {
      graph.ends.push_back(index.at(other));
      graph.edge_weights.push_back(weight);
    }
    graph.begins.push_back(idx_t(graph.ends.size()));
    graph.node_sizes.push_back(sizes[node]);
  }
  return graph;
}

// Part of each node of a connected graph.
std::vector<idx_t> CutByMetis(MetisGraph graph, int num_parts) {
  idx_t num_nodes = idx_t(graph.node_sizes.size());
  idx_t num_constraints = 1;
  idx_t parts = num_parts;
  idx_t cut = 0;
  std::vector<idx_t> part_of_node(graph.node_sizes.size());
  idx_t options[METIS_NOPTIONS];
  METIS_SetDefaultOptions(options);
  options[METIS_OPTION_SEED] = 0;
  options[METIS_OPTION_CONTIG] = 1;
  options[METIS_OPTION_UFACTOR] = idx_t(1000 * kMaxImbalance);
  if (METIS_PartGraphKway(&num_nodes,
                          &num_constraints,
                          graph.begins.data(),
                          graph.ends.data(),
                          graph.node_sizes.data(),
                          nullptr,
                          graph.edge_weights.data(),
                          &parts,
                          nullptr,
                          nullptr,
                          options,
                          &cut,
                          part_of_node.data()) != METIS_OK) {
    throw std::runtime_error("METIS cannot partition a graph of " +
                             std::to_string(num_nodes) + " nodes");
  }
  return part_of_node;
}

// Cores of a component, of at most max_size each where nodes allow it.
std::vector<Nodes> CutComponent(const Nodes& nodes,
                                const std::vector<int>& sizes,
                                const Neighbors& neighbors,
                                int max_size) {
  const MetisGraph graph = MetisGraphOf(nodes, sizes, neighbors);
  const int total = SizeOf(nodes, sizes);
  const int first = int(std::ceil(total / (max_size / (1 + kMaxImbalance))));
  std::vector<Nodes> cores;
  for (int num_parts = std::max(2, first); num_parts < int(nodes.size());
       num_parts += 1 + num_parts / 8) {
    const std::vector<idx_t> part_of_node = CutByMetis(graph, num_parts);
    cores.assign(num_parts, {});
    for (size_t i = 0; i < nodes.size(); ++i) {
      cores[part_of_node[i]].push_back(nodes[i]);
    }
    cores.erase(std::remove_if(cores.begin(),
                               cores.end(),
                               [](const Nodes& core) { return core.empty(); }),
                cores.end());
    if (std::all_of(cores.begin(), cores.end(), [&](const Nodes& core) {
          return SizeOf(core, sizes) <= max_size;
        })) {
      return cores;
    }
  }
  cores.clear();
  for (const int node : nodes) cores.push_back({node});
  return cores;
}

// The nodes of a core and of its neighbours.
class GrowingPart {
 public:
  GrowingPart(const Nodes& core,
              const std::vector<int>& sizes,
              const Neighbors& neighbors,
              const std::vector<int>& core_of_node)
      : sizes_(sizes), neighbors_(neighbors), core_of_node_(core_of_node) {
    for (const int node : core) Add(node);
  }

  // Adds nodes of size `room` together, in turns of each neighbour.
  void Grow(int room) {
    bool is_growing = true;
    while (is_growing) {
      is_growing = false;
      std::set<int> cores;
      for (const auto& [core, candidates] : candidates_) cores.insert(core);
      for (const int core : cores) {
        const int node = BestOf(core, room);
        if (node < 0) continue;
        room -= sizes_[node];
        Add(node);
        is_growing = true;
      }
    }
  }

  Nodes Sorted() const { return {nodes_.begin(), nodes_.end()}; }

 private:
  void Add(int node) {
    nodes_.insert(node);
    candidates_[core_of_node_[node]].erase(node);
    for (const auto& [other, weight] : neighbors_[node]) {
      if (nodes_.count(other) == 0) {
        candidates_[core_of_node_[other]][other] += weight;
      }
    }
  }

  // The node of a core that most weight joins to the part; -1 if none fits.
  int BestOf(int core, int room) const {
    int best = -1;
    double best_weight = 0;
    for (const auto& [node, weight] : candidates_.at(core)) {
      if (sizes_[node] <= room && weight > best_weight) {
        best = node;
        best_weight = weight;
      }
    }
    return best;
  }

  const std::vector<int>& sizes_;
  const Neighbors& neighbors_;
  const std::vector<int>& core_of_node_;
  std::set<int> nodes_;
  // Neighbours by their cores, with the weight that joins them.
  std::map<int, std::map<int, double>> candidates_;
};

// Joins parts that have room, in the order given.
std::vector<Nodes> FillParts(const std::vector<Nodes>& components,
                             const std::vector<int>& sizes,
                             int max_size) {
  std::vector<Nodes> parts;
  int room = 0;
  for (const Nodes& nodes : components) {
    const int size = SizeOf(nodes, sizes);
    if (parts.empty() || size > room) {
      parts.emplace_back();
      room = max_size;
    }
    parts.back().insert(parts.back().end(), nodes.begin(), nodes.end());
    room -= size;
  }
  return parts;
}

}  // namespace

bool GraphPartitionOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_part_size", max_part_size, 10)
      .Within("overlap", overlap, 0, 0.8)
      .AreKept();
}

std::vector<std::vector<int>> PartitionGraph(
    const GraphPartitionOptions& options,
    const std::vector<int>& node_sizes,
    const std::vector<GraphEdge>& edges,
    const std::vector<int>& weights) {
  DGSFM_CHECK(edges.size() == weights.size());
  const int num_nodes = int(node_sizes.size());
  const Neighbors neighbors = NeighborsOf(num_nodes, edges, weights);
  std::vector<Nodes> components;
  const std::vector<int> component = ConnectedComponents(num_nodes, edges);
  for (int node = 0; node < num_nodes; ++node) {
    components.resize(std::max<size_t>(components.size(), component[node] + 1));
    components[component[node]].push_back(node);
  }
  const int max_size = options.max_part_size;
  const int room = int(options.overlap * max_size);
  std::vector<Nodes> small, cores;
  for (const Nodes& nodes : components) {
    if (SizeOf(nodes, node_sizes) <= max_size) {
      small.push_back(nodes);
      continue;
    }
    for (Nodes& core :
         CutComponent(nodes, node_sizes, neighbors, max_size - room)) {
      cores.push_back(std::move(core));
    }
  }
  std::vector<int> core_of_node(num_nodes, -1);
  for (size_t i = 0; i < cores.size(); ++i) {
    for (const int node : cores[i]) core_of_node[node] = int(i);
  }
  std::vector<Nodes> parts = FillParts(small, node_sizes, max_size);
  for (const Nodes& core : cores) {
    GrowingPart part(core, node_sizes, neighbors, core_of_node);
    part.Grow(std::min(room, max_size - SizeOf(core, node_sizes)));
    parts.push_back(part.Sorted());
  }
  for (Nodes& nodes : parts) std::sort(nodes.begin(), nodes.end());
  std::sort(parts.begin(), parts.end());
  return parts;
}

}  // namespace dgsfm
