// Graph algorithms on integer nodes 0..N-1, deterministic in the order of the
// given edges. Nodes out of range throw; parallel edges and self-loops are
// allowed except where noted.

#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

namespace dgsfm {

using GraphEdge = std::pair<int, int>;

// Component index of each node; components are numbered by decreasing size,
// ties by their smallest node.
std::vector<int> ConnectedComponents(int num_nodes,
                                     const std::vector<GraphEdge>& edges);

// Nodes of component 0, in increasing order.
std::vector<int> LargestComponent(int num_nodes,
                                  const std::vector<GraphEdge>& edges);

// A spanning tree rooted at `root`, over the nodes reachable from it.
struct SpanningTree {
  int root = -1;
  // Per node: parent (-1 at the root and for unreachable nodes) and the index
  // of the edge to it.
  std::vector<int> parents;
  std::vector<int> parent_edges;
  // Reachable nodes from the root on, parents before children.
  std::vector<int> order;
};

// Maximum spanning tree (Kruskal; equal weights: the earlier edge wins).
// Throws on weights that are no numbers.
SpanningTree MaximumSpanningTree(int num_nodes,
                                 const std::vector<GraphEdge>& edges,
                                 const std::vector<double>& weights,
                                 int root);

// Calls visit(edge1, edge2, edge3) once per triangle, in a fixed order.
// Triangles are streamed, never listed: time O(E^1.5), memory O(N + E). Of
// parallel edges one may stand for the others. Self-loops are in no triangle.
void VisitTriangles(int num_nodes,
                    const std::vector<GraphEdge>& edges,
                    const std::function<void(int, int, int)>& visit);

// Edges of a closed path, and whether it runs from their first node to their
// second.
struct GraphStep {
  int edge = 0;
  bool is_forward = true;
};
using GraphLoop = std::array<GraphStep, 3>;

// Number of the triangles with each edge for which `is_counted` holds; the path
// starts along the triangle's first edge.
std::vector<double> CountTriangles(
    int num_nodes,
    const std::vector<GraphEdge>& edges,
    const std::function<bool(const GraphLoop&)>& is_counted);

// Triplet support of each edge (Manam 2024; DGSfM Eq. 2 and 3): the mean over
// the triangles with this edge of n_edge / max n of the triangle's edges; -1
// for edges in no triangle. Throws on parallel edges, self-loops and counts
// that are not finite and positive.
std::vector<double> TripletSupport(int num_nodes,
                                   const std::vector<GraphEdge>& edges,
                                   const std::vector<double>& counts);

}  // namespace dgsfm
