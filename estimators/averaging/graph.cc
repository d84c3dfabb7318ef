#include "estimators/averaging/graph.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace dgsfm {
namespace {

void CheckEdges(int num_nodes, const std::vector<GraphEdge>& edges) {
  DGSFM_CHECK(num_nodes >= 0) << "num_nodes = " << num_nodes;
  for (const auto& [node1, node2] : edges) {
    DGSFM_CHECK(node1 >= 0 && node1 < num_nodes && node2 >= 0 &&
                node2 < num_nodes)
        << "edge (" << node1 << ", " << node2 << ") with " << num_nodes
        << " nodes";
  }
}

void CheckNoParallelEdges(std::vector<GraphEdge> edges) {
  for (GraphEdge& edge : edges) edge = std::minmax({edge.first, edge.second});
  std::sort(edges.begin(), edges.end());
  const auto parallel = std::adjacent_find(edges.begin(), edges.end());
  DGSFM_CHECK(parallel == edges.end())
      << "parallel edges between nodes " << parallel->first << " and "
      << parallel->second;
}

class UnionFind {
 public:
  explicit UnionFind(int num_nodes) : parents_(num_nodes) {
    std::iota(parents_.begin(), parents_.end(), 0);
  }

  int Find(int node) {
    while (parents_[node] != node) {
      parents_[node] = parents_[parents_[node]];
      node = parents_[node];
    }
    return node;
  }

  // The smaller root wins, so that a root is the smallest node of its set.
  // Returns whether the nodes were apart.
  bool Union(int node1, int node2) {
    const auto [low, high] = std::minmax({Find(node1), Find(node2)});
    parents_[high] = low;
    return low != high;
  }

 private:
  std::vector<int> parents_;
};

// Neighbours of each node with the edge that leads to them, in the order of
// the edges.
class Adjacency {
 public:
  struct Link {
    int node;
    int edge;
  };
  struct LinkRange {
    const Link* first;
    const Link* last;
    const Link* begin() const { return first; }
    const Link* end() const { return last; }
  };

  // Takes the links for which keep(from, to, edge) holds.
  template <typename Predicate>
  Adjacency(int num_nodes,
            const std::vector<GraphEdge>& edges,
            const Predicate& keep)
      : begins_(num_nodes + 1, 0) {
    const auto visit_links = [&](const auto& visit) {
      for (size_t e = 0; e < edges.size(); ++e) {
        const auto& [node1, node2] = edges[e];
        const int edge = static_cast<int>(e);
        if (keep(node1, node2, edge)) visit(node1, Link{node2, edge});
        if (keep(node2, node1, edge)) visit(node2, Link{node1, edge});
      }
    };
    visit_links([&](int from, const Link&) { ++begins_[from + 1]; });
    std::partial_sum(begins_.begin(), begins_.end(), begins_.begin());
    links_.resize(begins_.back());
    std::vector<size_t> ends(begins_.begin(), begins_.end() - 1);
    visit_links(
        [&](int from, const Link& link) { links_[ends[from]++] = link; });
  }

  LinkRange Links(int node) const {
    return {links_.data() + begins_[node], links_.data() + begins_[node + 1]};
  }

 private:
  std::vector<size_t> begins_;
  std::vector<Link> links_;
};

}  // namespace

std::vector<int> ConnectedComponents(int num_nodes,
                                     const std::vector<GraphEdge>& edges) {
  CheckEdges(num_nodes, edges);
  UnionFind sets(num_nodes);
  for (const auto& [node1, node2] : edges) sets.Union(node1, node2);

  std::vector<int> sizes(num_nodes, 0);
  for (int node = 0; node < num_nodes; ++node) ++sizes[sets.Find(node)];
  std::vector<int> roots;
  for (int node = 0; node < num_nodes; ++node) {
    if (sizes[node] > 0) roots.push_back(node);
  }
  // Roots are the smallest nodes and in order: a stable sort keeps the ties.
  std::stable_sort(roots.begin(), roots.end(), [&](int root1, int root2) {
    return sizes[root1] > sizes[root2];
  });

  std::vector<int> component_of_root(num_nodes, -1);
  for (size_t c = 0; c < roots.size(); ++c) {
    component_of_root[roots[c]] = static_cast<int>(c);
  }
  std::vector<int> components(num_nodes);
  for (int node = 0; node < num_nodes; ++node) {
    components[node] = component_of_root[sets.Find(node)];
  }
  return components;
}

std::vector<int> LargestComponent(int num_nodes,
                                  const std::vector<GraphEdge>& edges) {
  const std::vector<int> components = ConnectedComponents(num_nodes, edges);
  std::vector<int> nodes;
  for (int node = 0; node < num_nodes; ++node) {
    if (components[node] == 0) nodes.push_back(node);
  }
  return nodes;
}

SpanningTree MaximumSpanningTree(int num_nodes,
                                 const std::vector<GraphEdge>& edges,
                                 const std::vector<double>& weights,
                                 int root) {
  CheckEdges(num_nodes, edges);
  DGSFM_CHECK(weights.size() == edges.size());
  DGSFM_CHECK(root >= 0 && root < num_nodes) << "root = " << root;
  for (const double weight : weights) {
    DGSFM_CHECK(!std::isnan(weight)) << "weight of an edge is not a number";
  }

  std::vector<int> edges_by_weight(edges.size());
  std::iota(edges_by_weight.begin(), edges_by_weight.end(), 0);
  std::stable_sort(edges_by_weight.begin(),
                   edges_by_weight.end(),
                   [&](int e1, int e2) { return weights[e1] > weights[e2]; });
  UnionFind sets(num_nodes);
  std::vector<char> in_tree(edges.size(), 0);
  for (const int e : edges_by_weight) {
    in_tree[e] = sets.Union(edges[e].first, edges[e].second);
  }

  const Adjacency adjacency(
      num_nodes, edges, [&](int, int, int edge) { return in_tree[edge]; });
  SpanningTree tree;
  tree.root = root;
  tree.parents.assign(num_nodes, -1);
  tree.parent_edges.assign(num_nodes, -1);
  tree.order.push_back(root);
  for (size_t k = 0; k < tree.order.size(); ++k) {
    const int node = tree.order[k];
    for (const auto& [neighbor, edge] : adjacency.Links(node)) {
      if (edge == tree.parent_edges[node]) continue;
      tree.parents[neighbor] = node;
      tree.parent_edges[neighbor] = edge;
      tree.order.push_back(neighbor);
    }
  }
  return tree;
}

// Links lead to nodes of higher degree only: each triangle is found from its
// node of lowest degree, and all lists stay short.
void VisitTriangles(int num_nodes,
                    const std::vector<GraphEdge>& edges,
                    const std::function<void(int, int, int)>& visit) {
  CheckEdges(num_nodes, edges);
  std::vector<int> degrees(num_nodes, 0);
  for (const auto& [node1, node2] : edges) {
    ++degrees[node1];
    ++degrees[node2];
  }
  const Adjacency adjacency(num_nodes, edges, [&](int from, int to, int) {
    return std::make_pair(degrees[from], from) <
           std::make_pair(degrees[to], to);
  });

  std::vector<int> edge_from_lowest(num_nodes, -1);
  for (int lowest = 0; lowest < num_nodes; ++lowest) {
    for (const auto& link : adjacency.Links(lowest)) {
      edge_from_lowest[link.node] = link.edge;
    }
    for (const auto& link : adjacency.Links(lowest)) {
      if (edge_from_lowest[link.node] != link.edge) continue;
      for (const auto& next : adjacency.Links(link.node)) {
        const int closing_edge = edge_from_lowest[next.node];
        if (closing_edge >= 0) visit(link.edge, next.edge, closing_edge);
      }
    }
    for (const auto& link : adjacency.Links(lowest)) {
      edge_from_lowest[link.node] = -1;
    }
  }
}

std::vector<double> CountTriangles(
    int num_nodes,
    const std::vector<GraphEdge>& edges,
    const std::function<bool(const GraphLoop&)>& is_counted) {
  std::vector<double> counts(edges.size(), 0);
  VisitTriangles(num_nodes, edges, [&](int edge1, int edge2, int edge3) {
    int node = edges[edge1].second;
    if (edges[edge2].first != node && edges[edge2].second != node) {
      std::swap(edge2, edge3);
    }
    GraphLoop loop = {{{edge1, true}, {edge2}, {edge3}}};
    for (size_t i = 1; i < loop.size(); ++i) {
      const auto& [node1, node2] = edges[loop[i].edge];
      loop[i].is_forward = node1 == node;
      node = node1 == node ? node2 : node1;
    }
    if (!is_counted(loop)) return;
    for (const GraphStep& step : loop) ++counts[step.edge];
  });
  return counts;
}

std::vector<double> TripletSupport(int num_nodes,
                                   const std::vector<GraphEdge>& edges,
                                   const std::vector<double>& counts) {
  CheckEdges(num_nodes, edges);
  DGSFM_CHECK(counts.size() == edges.size());
  for (size_t e = 0; e < edges.size(); ++e) {
    DGSFM_CHECK(std::isfinite(counts[e]) && counts[e] > 0)
        << "count of edge " << e << " = " << counts[e];
    DGSFM_CHECK(edges[e].first != edges[e].second) << "self-loop " << e;
  }
  CheckNoParallelEdges(edges);

  std::vector<double> ratio_sums(edges.size(), 0);
  std::vector<size_t> num_triangles(edges.size(), 0);
  VisitTriangles(num_nodes, edges, [&](int edge1, int edge2, int edge3) {
    const double max_count =
        std::max({counts[edge1], counts[edge2], counts[edge3]});
    for (const int e : {edge1, edge2, edge3}) {
      ratio_sums[e] += counts[e] / max_count;
      ++num_triangles[e];
    }
  });

  std::vector<double> supports(edges.size(), -1);
  for (size_t e = 0; e < edges.size(); ++e) {
    if (num_triangles[e] > 0) supports[e] = ratio_sums[e] / num_triangles[e];
  }
  return supports;
}

}  // namespace dgsfm
