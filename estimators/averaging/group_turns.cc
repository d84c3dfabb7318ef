#include "estimators/averaging/group_turns.h"

#include "estimators/averaging/graph.h"

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

namespace dgsfm {

namespace {

// Moves from each start. Twins take up to three.
constexpr int kMaxNumMoves = 10;
// Turns below are asked for by pairs that are inaccurate [max_error_rad].
constexpr double kMinTurn = 3;
// Outliers from which groups grow, for each move.
constexpr int kMaxNumSeeds = 100;
// Nodes by which groups grow on without lowering the cost.
constexpr size_t kMaxNumNodesInVain = 1000;
// Groups that are averaged, the most promising first, until one lowers the
// cost.
constexpr int kMaxNumTrials = 10;
// Changes of the cost below are rounding [nat].
constexpr double kMinGain = 1e-6;

// Nodes that turn together.
struct Group {
  double change = 0;  // of the cost [nat]
  Eigen::Quaterniond turn;
  std::vector<int> nodes;
};

using Edges = std::vector<JudgedRotation>;
using Rotations = std::vector<Eigen::Quaterniond>;

bool IsOff(const RelativeRotation& relative,
           const Eigen::Quaterniond& rotation1,
           const Eigen::Quaterniond& rotation2,
           double max_error_rad) {
  return (rotation2 * rotation1.conjugate())
             .angularDistance(relative.cam2_from_cam1) > max_error_rad;
}

double CostOf(const JudgedRotation& edge, bool is_outlier) {
  return is_outlier ? edge.cost_if_outlier : edge.cost_if_kept;
}

// The outliers that cost most, these first.
std::vector<int> FindSeeds(const Edges& edges,
                           double max_error_rad,
                           const Rotations& rotations) {
  const std::vector<char> is_far_off =
      FindOutliers(edges, kMinTurn * max_error_rad, rotations);
  std::vector<int> seeds;
  for (int e = 0; e < int(edges.size()); ++e) {
    if (is_far_off[e]) seeds.push_back(e);
  }
  std::stable_sort(seeds.begin(), seeds.end(), [&](int e, int f) {
    return edges[e].cost_if_outlier > edges[f].cost_if_outlier;
  });
  if (seeds.size() > kMaxNumSeeds) seeds.resize(kMaxNumSeeds);
  return seeds;
}

// Grows groups of nodes that turn together.
class GroupGrowth {
 public:
  GroupGrowth(const Edges& edges,
              double max_error_rad,
              const Rotations& rotations)
      : edges_(edges),
        max_error_rad_(max_error_rad),
        rotations_(rotations),
        edges_at_(rotations.size()) {
    for (int e = 0; e < int(edges.size()); ++e) {
      edges_at_[edges[e].relative.node1].push_back(e);
      edges_at_[edges[e].relative.node2].push_back(e);
    }
  }

  // The best group with the second node of an outlier, which the turn makes
  // right, and without the first; nothing if none lowers the cost.
  std::optional<Group> From(int seed) {
    const RelativeRotation& relative = edges_[seed].relative;
    turn_ = rotations_[relative.node2].conjugate() * relative.cam2_from_cam1 *
            rotations_[relative.node1];
    states_.assign(rotations_.size(), NodeState::FAR);
    gains_.assign(rotations_.size(), 0);
    waiting_.clear();
    states_[relative.node1] = NodeState::FIXED;
    Touch(relative.node2);
    Group group = {0, turn_, {}};
    double change = 0;
    size_t best_size = 0;
    while (!waiting_.empty() &&
           group.nodes.size() < best_size + kMaxNumNodesInVain) {
      const auto [gain, node] = *waiting_.begin();
      change += gain;
      group.nodes.push_back(node);
      Add(node);
      if (change < group.change - kMinGain) {
        group.change = change;
        best_size = group.nodes.size();
      }
    }
    if (best_size == 0) return std::nullopt;
    group.nodes.resize(best_size);
    std::sort(group.nodes.begin(), group.nodes.end());
    return group;
  }

 private:
  enum class NodeState : char { FAR, FIXED, WAITING, TURNED };

  // How the cost of an edge changes if one of its nodes turns and the other
  // does not.
  double ChangeByTurnOf(int node, const JudgedRotation& edge) const {
    const RelativeRotation& relative = edge.relative;
    const Eigen::Quaterniond& rotation1 = rotations_[relative.node1];
    const Eigen::Quaterniond& rotation2 = rotations_[relative.node2];
    const bool is_off = IsOff(relative, rotation1, rotation2, max_error_rad_);
    const bool is_off_turned =
        relative.node1 == node
            ? IsOff(relative, rotation1 * turn_, rotation2, max_error_rad_)
            : IsOff(relative, rotation1, rotation2 * turn_, max_error_rad_);
    return CostOf(edge, is_off_turned) - CostOf(edge, is_off);
  }

  // Lets a node wait that the group did not touch before.
  void Touch(int node) {
    for (const int e : edges_at_[node]) {
      gains_[node] += ChangeByTurnOf(node, edges_[e]);
    }
    states_[node] = NodeState::WAITING;
    waiting_.insert({gains_[node], node});
  }

  void Add(int node) {
    waiting_.erase({gains_[node], node});
    states_[node] = NodeState::TURNED;
    for (const int e : edges_at_[node]) {
      const RelativeRotation& relative = edges_[e].relative;
      const int other =
          relative.node1 == node ? relative.node2 : relative.node1;
      if (states_[other] == NodeState::FAR) Touch(other);
      if (states_[other] != NodeState::WAITING) continue;
      waiting_.erase({gains_[other], other});
      // An edge costs what it did once both its nodes are turned.
      gains_[other] -=
          ChangeByTurnOf(node, edges_[e]) + ChangeByTurnOf(other, edges_[e]);
      waiting_.insert({gains_[other], other});
    }
  }

  const Edges& edges_;
  const double max_error_rad_;
  const Rotations& rotations_;
  std::vector<std::vector<int>> edges_at_;
  // The growth from one outlier uses what follows.
  Eigen::Quaterniond turn_;
  std::vector<NodeState> states_;
  // Changes of the cost by one more node.
  std::vector<double> gains_;
  // Neighbours, the next one first.
  std::set<std::pair<double, int>> waiting_;
};

// Groups whose turn lowers the cost, the most promising first.
std::vector<Group> FindGroups(const Edges& edges,
                              double max_error_rad,
                              const Rotations& rotations) {
  std::vector<Group> groups;
  GroupGrowth growth(edges, max_error_rad, rotations);
  std::set<std::vector<int>> found;
  for (const int seed : FindSeeds(edges, max_error_rad, rotations)) {
    std::optional<Group> group = growth.From(seed);
    if (group && found.insert(group->nodes).second) {
      groups.push_back(std::move(*group));
    }
  }
  std::stable_sort(
      groups.begin(), groups.end(), [](const Group& a, const Group& b) {
        return a.change < b.change;
      });
  if (groups.size() > kMaxNumTrials) groups.resize(kMaxNumTrials);
  return groups;
}

Rotations TurnedBy(const Group& group,
                   int fixed_node,
                   const Rotations& rotations) {
  Rotations turned = rotations;
  for (const int node : group.nodes) turned[node] = turned[node] * group.turn;
  const Eigen::Quaterniond back =
      turned[fixed_node].conjugate() * rotations[fixed_node];
  for (Eigen::Quaterniond& rotation : turned) {
    rotation = (rotation * back).normalized();
  }
  return turned;
}

// Averages the edges that are no outliers; false if these do not connect all.
bool AverageKept(const Edges& edges,
                 double max_error_rad,
                 int fixed_node,
                 const GraphAveragingOptions& averaging,
                 Rotations* rotations) {
  const std::vector<char> is_outlier =
      FindOutliers(edges, max_error_rad, *rotations);
  std::vector<RelativeRotation> kept;
  for (size_t e = 0; e < edges.size(); ++e) {
    if (!is_outlier[e]) kept.push_back(edges[e].relative);
  }
  return AverageRotations(
      int(rotations->size()), kept, fixed_node, averaging, rotations);
}

// Rotations that chain the edges of a spanning tree, those with most evidence;
// false without one.
bool AverageTree(const Edges& edges,
                 int fixed_node,
                 const GraphAveragingOptions& averaging,
                 Rotations* rotations) {
  std::vector<GraphEdge> graph_edges;
  std::vector<double> weights;
  for (const JudgedRotation& edge : edges) {
    graph_edges.emplace_back(edge.relative.node1, edge.relative.node2);
    weights.push_back(edge.cost_if_outlier - edge.cost_if_kept);
  }
  const SpanningTree tree = MaximumSpanningTree(
      int(rotations->size()), graph_edges, weights, fixed_node);
  std::vector<RelativeRotation> chained;
  for (const int e : tree.parent_edges) {
    if (e >= 0) chained.push_back(edges[e].relative);
  }
  return AverageRotations(
      int(rotations->size()), chained, fixed_node, averaging, rotations);
}

// Turns the first group that lowers the cost, if there is one.
bool MakeMove(const Edges& edges,
              double max_error_rad,
              int fixed_node,
              const GraphAveragingOptions& averaging,
              Rotations* rotations) {
  const double cost = CostOfRotations(edges, max_error_rad, *rotations);
  for (const Group& group : FindGroups(edges, max_error_rad, *rotations)) {
    Rotations turned = TurnedBy(group, fixed_node, *rotations);
    if (AverageKept(edges, max_error_rad, fixed_node, averaging, &turned) &&
        CostOfRotations(edges, max_error_rad, turned) < cost - kMinGain) {
      *rotations = std::move(turned);
      return true;
    }
  }
  return false;
}

}  // namespace

std::vector<char> FindOutliers(
    const std::vector<JudgedRotation>& judged,
    double max_error_rad,
    const std::vector<Eigen::Quaterniond>& rotations) {
  std::vector<char> is_outlier;
  is_outlier.reserve(judged.size());
  for (const JudgedRotation& edge : judged) {
    is_outlier.push_back(IsOff(edge.relative,
                               rotations[edge.relative.node1],
                               rotations[edge.relative.node2],
                               max_error_rad));
  }
  return is_outlier;
}

double CostOfRotations(const std::vector<JudgedRotation>& judged,
                       double max_error_rad,
                       const std::vector<Eigen::Quaterniond>& rotations) {
  const std::vector<char> is_outlier =
      FindOutliers(judged, max_error_rad, rotations);
  double cost = 0;
  for (size_t e = 0; e < judged.size(); ++e) {
    cost += CostOf(judged[e], is_outlier[e]);
  }
  return cost;
}

std::vector<Eigen::Quaterniond> TurnGroups(
    const std::vector<JudgedRotation>& judged,
    double max_error_rad,
    int fixed_node,
    const GraphAveragingOptions& averaging,
    const std::vector<Eigen::Quaterniond>& rotations) {
  Rotations best = rotations;
  double best_cost = CostOfRotations(judged, max_error_rad, best);
  std::vector<Rotations> starts = {rotations, rotations};
  if (!AverageTree(judged, fixed_node, averaging, &starts[1])) return best;
  for (Rotations& start : starts) {
    int num_moves = 0;
    while (num_moves < kMaxNumMoves &&
           MakeMove(judged, max_error_rad, fixed_node, averaging, &start)) {
      ++num_moves;
    }
    const double cost = CostOfRotations(judged, max_error_rad, start);
    if (cost >= best_cost - kMinGain) continue;
    best = std::move(start);
    best_cost = cost;
  }
  return best;
}

}  // namespace dgsfm
