#include "estimators/averaging/approximate_cholesky.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <tuple>

namespace dgsfm {
namespace {

// Edges per node that a sample has, some more or less.
constexpr double kNumSamplesPerNode = 8;

// Uniform in [0, 1), the same with every standard library.
double Draw(std::mt19937_64* random) {
  return std::ldexp(double((*random)() >> 11), -53);
}

// Nodes by their number of edges; of those with the fewest, the one that came
// last. Nodes with more edges than there are nodes share the last list.
class DegreeQueue {
 public:
  explicit DegreeQueue(const std::vector<int>& degrees)
      : degrees_(degrees),
        next_(degrees.size(), -1),
        previous_(degrees.size(), -1),
        heads_(degrees.size(), -1) {
    for (int node = int(degrees.size()) - 1; node >= 0; --node) Insert(node);
  }

  // A node must be left.
  int Pop() {
    while (heads_[lowest_] < 0) ++lowest_;
    const int node = heads_[lowest_];
    Remove(node);
    return node;
  }

  void Change(int node, int difference) {
    const int list = ListOf(node);
    Remove(node);
    degrees_[node] += difference;
    Insert(node);
    if (ListOf(node) < list) lowest_ = std::min(lowest_, ListOf(node));
  }

 private:
  int ListOf(int node) const {
    return std::min(degrees_[node], int(heads_.size()) - 1);
  }

  void Insert(int node) {
    int& head = heads_[ListOf(node)];
    next_[node] = head;
    previous_[node] = -1;
    if (head >= 0) previous_[head] = node;
    head = node;
  }

  void Remove(int node) {
    if (previous_[node] >= 0) {
      next_[previous_[node]] = next_[node];
    } else {
      heads_[ListOf(node)] = next_[node];
    }
    if (next_[node] >= 0) previous_[next_[node]] = previous_[node];
  }

  std::vector<int> degrees_;
  std::vector<int> next_;
  std::vector<int> previous_;
  std::vector<int> heads_;
  int lowest_ = 0;
};

// The graph while nodes leave it. An edge has two entries, 2e and 2e + 1, in
// the lists of its ends; an entry of weight zero has left.
class ShrinkingGraph {
 public:
  struct Neighbor {
    int node;
    int entry;
    double weight;
  };

  ShrinkingGraph(int num_nodes,
                 const std::vector<GraphEdge>& edges,
                 const Eigen::VectorXd& weights)
      : heads_(num_nodes, -1), degrees_(num_nodes, 0) {
    DGSFM_CHECK(edges.size() < size_t(std::numeric_limits<int>::max() / 2))
        << edges.size() << " edges";
    DGSFM_CHECK(weights.size() == Eigen::Index(edges.size()));
    entries_.reserve(2 * edges.size());
    for (size_t e = 0; e < edges.size(); ++e) {
      const auto [node1, node2] = edges[e];
      DGSFM_CHECK(node1 >= 0 && node1 < num_nodes && node2 >= 0 &&
                  node2 < num_nodes)
          << "edge (" << node1 << ", " << node2 << ") with " << num_nodes
          << " nodes";
      if (node1 == node2) continue;
      Append(node1, node2, weights(e));
      Append(node2, node1, weights(e));
    }
  }

  const std::vector<int>& Degrees() const { return degrees_; }

  // Neighbours of a node, the weakest first. One of parallel edges has the
  // weight of all, the others go to `merged`.
  void Neighbors(int node,
                 std::vector<Neighbor>* neighbors,
                 std::vector<Neighbor>* merged) const {
    neighbors->clear();
    merged->clear();
    for (int i = heads_[node]; i >= 0; i = entries_[i].next) {
      if (entries_[i].weight > 0) {
        neighbors->push_back({entries_[i].node, i, entries_[i].weight});
      }
    }
    std::sort(neighbors->begin(),
              neighbors->end(),
              [](const Neighbor& a, const Neighbor& b) {
                return std::tie(a.node, a.entry) < std::tie(b.node, b.entry);
              });
    size_t num_kept = 0;
    for (const Neighbor& neighbor : *neighbors) {
      if (num_kept > 0 && (*neighbors)[num_kept - 1].node == neighbor.node) {
        (*neighbors)[num_kept - 1].weight += neighbor.weight;
        merged->push_back(neighbor);
      } else {
        (*neighbors)[num_kept++] = neighbor;
      }
    }
    neighbors->resize(num_kept);
    std::sort(neighbors->begin(),
              neighbors->end(),
              [](const Neighbor& a, const Neighbor& b) {
                return std::tie(a.weight, a.node) < std::tie(b.weight, b.node);
              });
  }

  // Takes an edge of the node that leaves out of its neighbour's list.
  void Remove(const Neighbor& neighbor) {
    entries_[neighbor.entry ^ 1].weight = 0;
  }

  // Makes the edge to `neighbor` one between it and another neighbour.
  void Redirect(const Neighbor& neighbor, int other, double weight) {
    entries_[neighbor.entry ^ 1].node = other;
    entries_[neighbor.entry ^ 1].weight = weight;
    entries_[neighbor.entry] = {neighbor.node, heads_[other], weight};
    heads_[other] = neighbor.entry;
  }

 private:
  struct Entry {
    int node;
    int next;
    double weight;
  };

  void Append(int from, int to, double weight) {
    entries_.push_back({to, heads_[from], weight});
    heads_[from] = int(entries_.size()) - 1;
    ++degrees_[from];
  }

  std::vector<Entry> entries_;
  std::vector<int> heads_;
  std::vector<int> degrees_;
};

}  // namespace

Eigen::VectorXd LaplacianDiagonal(int num_nodes,
                                  const std::vector<GraphEdge>& edges,
                                  const Eigen::VectorXd& weights) {
  Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(num_nodes);
  for (size_t e = 0; e < edges.size(); ++e) {
    if (edges[e].first == edges[e].second) continue;
    diagonal(edges[e].first) += weights(e);
    diagonal(edges[e].second) += weights(e);
  }
  return diagonal;
}

WeightedEdges SampleEdges(int num_nodes,
                          const std::vector<GraphEdge>& edges,
                          const Eigen::VectorXd& weights) {
  const Eigen::VectorXd diagonal = LaplacianDiagonal(num_nodes, edges, weights);
  const SpanningTree tree = MaximumSpanningTree(
      num_nodes, edges, {weights.begin(), weights.end()}, /*root=*/0);
  std::vector<char> is_in_tree(edges.size(), 0);
  for (const int e : tree.parent_edges) {
    if (e >= 0) is_in_tree[e] = 1;
  }
  std::mt19937_64 random;
  WeightedEdges sample;
  std::vector<double> sampled_weights;
  for (size_t e = 0; e < edges.size(); ++e) {
    const auto [node1, node2] = edges[e];
    const double probability =
        is_in_tree[e]
            ? 1.0
            : std::min(1.0,
                       kNumSamplesPerNode * weights(e) *
                           (1 / diagonal(node1) + 1 / diagonal(node2)));
    if (Draw(&random) >= probability) continue;
    sample.edges.push_back(edges[e]);
    sampled_weights.push_back(weights(e) / probability);
  }
  sample.weights = Eigen::Map<const Eigen::VectorXd>(sampled_weights.data(),
                                                     sampled_weights.size());
  return sample;
}

ApproximateCholesky::ApproximateCholesky(int num_nodes,
                                         const std::vector<GraphEdge>& edges,
                                         const Eigen::VectorXd& weights) {
  ShrinkingGraph graph(num_nodes, edges, weights);
  DegreeQueue queue(graph.Degrees());
  std::mt19937_64 random;
  steps_.reserve(num_nodes);
  std::vector<ShrinkingGraph::Neighbor> neighbors;
  std::vector<ShrinkingGraph::Neighbor> merged;
  std::vector<double> sums;
  for (int i = 0; i < num_nodes; ++i) {
    const int node = queue.Pop();
    graph.Neighbors(node, &neighbors, &merged);
    for (const auto& neighbor : merged) {
      graph.Remove(neighbor);
      queue.Change(neighbor.node, -1);
    }
    if (i + 1 == num_nodes) break;
    DGSFM_CHECK(!neighbors.empty()) << "the graph is not connected";
    sums.clear();
    double sum = 0;
    for (const auto& neighbor : neighbors) {
      sums.push_back(sum += neighbor.weight);
    }
    // What is left of the node's edges, and of their total, once those of the
    // neighbours before are eliminated.
    double remaining = 1;
    double total = sum;
    const size_t last = neighbors.size() - 1;
    for (size_t n = 0; n < last; ++n) {
      const double share = neighbors[n].weight * remaining / total;
      const double drawn = sums[n] + Draw(&random) * (sum - sums[n]);
      const size_t other = std::min<size_t>(
          last,
          std::upper_bound(sums.begin() + n + 1, sums.end(), drawn) -
              sums.begin());
      graph.Redirect(
          neighbors[n], neighbors[other].node, share * (1 - share) * total);
      queue.Change(neighbors[other].node, 1);
      neighbors_.push_back(neighbors[n].node);
      shares_.push_back(share);
      remaining *= 1 - share;
      total *= (1 - share) * (1 - share);
    }
    graph.Remove(neighbors[last]);
    queue.Change(neighbors[last].node, -1);
    neighbors_.push_back(neighbors[last].node);
    shares_.push_back(1);
    steps_.push_back(
        {node, neighbors[last].weight * remaining, neighbors_.size()});
  }
}

template <int kNumColumns>
void ApproximateCholesky::Apply(NodeVectors<kNumColumns>* vectors) const {
  size_t n = 0;
  for (const Step& step : steps_) {
    auto value = vectors->row(step.node);
    for (; n < step.end; ++n) {
      vectors->row(neighbors_[n]) += shares_[n] * value;
      if (n + 1 < step.end) value *= 1 - shares_[n];
    }
  }
  for (const Step& step : steps_) vectors->row(step.node) /= step.pivot;
  for (auto step = steps_.rbegin(); step != steps_.rend(); ++step) {
    auto value = vectors->row(step->node);
    const size_t begin = step + 1 == steps_.rend() ? 0 : (step + 1)->end;
    value += vectors->row(neighbors_[step->end - 1]);
    for (n = step->end - 1; n > begin; --n) {
      value += shares_[n - 1] * (vectors->row(neighbors_[n - 1]) - value);
    }
  }
  vectors->rowwise() -= vectors->colwise().mean().eval();
}

template void ApproximateCholesky::Apply(NodeVectors<1>* vectors) const;
template void ApproximateCholesky::Apply(NodeVectors<3>* vectors) const;

}  // namespace dgsfm
