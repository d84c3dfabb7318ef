#include "estimators/averaging/rotation_averaging.h"

#include "colmap_ext/check.h"
#include "estimators/averaging/graph.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// Angle-axis vector of a rotation, angle in [0, pi]; stable at both ends.
Eigen::Vector3d LogRotation(const Eigen::Quaterniond& rotation) {
  const Eigen::AngleAxisd angle_axis(rotation);
  return angle_axis.angle() * angle_axis.axis();
}

Eigen::Quaterniond ExpRotation(const Eigen::Vector3d& angle_axis) {
  const double angle = angle_axis.norm();
  if (angle == 0) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(
      Eigen::AngleAxisd(angle, Eigen::Vector3d(angle_axis / angle)));
}

Eigen::Quaterniond NormalizedChecked(const Eigen::Quaterniond& rotation) {
  // Negated to catch NaN.
  DGSFM_CHECK(std::abs(rotation.norm() - 1) < 1e-3)
      << "rotation is no unit quaternion: " << rotation.coeffs().transpose();
  return rotation.normalized();
}

// Whether three rotations lead back to the start within three standard
// deviations.
bool IsClosed(const std::vector<RelativeRotation>& relatives,
              const GraphLoop& loop) {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  double variance = 0;
  for (const auto& [e, is_forward] : loop) {
    const Eigen::Quaterniond& relative = relatives[e].cam2_from_cam1;
    rotation = (is_forward ? relative : relative.conjugate()) * rotation;
    variance += relatives[e].stddev_rad * relatives[e].stddev_rad;
  }
  return LogRotation(rotation).squaredNorm() <= 9 * variance;
}

std::vector<Eigen::Quaterniond> ChainAlongTree(
    const std::vector<RelativeRotation>& relative_rotations,
    const SpanningTree& tree) {
  std::vector<Eigen::Quaterniond> rotations(tree.parents.size(),
                                            Eigen::Quaterniond::Identity());
  for (const int node : tree.order) {
    if (node == tree.root) continue;
    const RelativeRotation& edge = relative_rotations[tree.parent_edges[node]];
    const Eigen::Quaterniond& node_from_parent =
        edge.node2 == node ? edge.cam2_from_cam1
                           : edge.cam2_from_cam1.conjugate();
    rotations[node] = node_from_parent * rotations[tree.parents[node]];
  }
  return rotations;
}

// Residual of each edge: log(R_2^T R_21 R_1).
Eigen::MatrixXd ComputeResiduals(
    const std::vector<RelativeRotation>& relatives,
    const std::vector<Eigen::Quaterniond>& estimates) {
  Eigen::MatrixXd residuals(relatives.size(), 3);
  for (size_t e = 0; e < relatives.size(); ++e) {
    residuals.row(e) = LogRotation(estimates[relatives[e].node2].conjugate() *
                                   relatives[e].cam2_from_cam1 *
                                   estimates[relatives[e].node1]);
  }
  return residuals;
}

std::vector<Eigen::Quaterniond> NormalizedChecked(
    std::vector<Eigen::Quaterniond> rotations) {
  for (Eigen::Quaterniond& rotation : rotations) {
    rotation = NormalizedChecked(rotation);
  }
  return rotations;
}

std::vector<RelativeRotation> NormalizedChecked(
    std::vector<RelativeRotation> relatives) {
  for (size_t i = 0; i < relatives.size(); ++i) {
    RelativeRotation& relative = relatives[i];
    DGSFM_CHECK(relative.node1 != relative.node2)
        << "self-loop at node " << relative.node1;
    DGSFM_CHECK(std::isfinite(relative.weight) && relative.weight > 0)
        << "weight of edge " << i << " = " << relative.weight;
    relative.cam2_from_cam1 = NormalizedChecked(relative.cam2_from_cam1);
  }
  return relatives;
}

}  // namespace

bool AverageRotations(int num_nodes,
                      const std::vector<RelativeRotation>& relative_rotations,
                      int fixed_node,
                      const GraphAveragingOptions& options,
                      std::vector<Eigen::Quaterniond>* rotations) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const std::vector<RelativeRotation> relatives =
      NormalizedChecked(relative_rotations);
  std::vector<GraphEdge> edges;
  Eigen::VectorXd stddevs(relatives.size());
  Eigen::VectorXd weights(relatives.size());
  for (const RelativeRotation& relative : relatives) {
    edges.emplace_back(relative.node1, relative.node2);
    stddevs(edges.size() - 1) = relative.stddev_rad;
    weights(edges.size() - 1) = relative.weight;
  }
  CheckStddevs(stddevs);
  const std::vector<double> num_closing_triangles =
      CountTriangles(num_nodes, edges, [&](const GraphLoop& loop) {
        return IsClosed(relatives, loop);
      });
  std::vector<double> tree_weights = num_closing_triangles;
  for (size_t e = 0; e < tree_weights.size(); ++e) {
    tree_weights[e] = weights(e) * (1 + tree_weights[e]);
  }
  const SpanningTree tree =
      MaximumSpanningTree(num_nodes, edges, tree_weights, fixed_node);
  if (static_cast<int>(tree.order.size()) < num_nodes) return false;

  const bool has_start = static_cast<int>(rotations->size()) == num_nodes;
  std::vector<Eigen::Quaterniond> estimates =
      has_start ? NormalizedChecked(*rotations)
                : ChainAlongTree(relatives, tree);
  // With R_i <- R_i exp(x_i), the residual e changes by x_1 - x_2 to first
  // order. The exact derivative has the same gradient, for e is an eigenvector
  // of its own Jacobian: fixed points are minima.
  const auto apply_steps = [&](const Eigen::MatrixXd& steps) {
    for (int node = 0; node < num_nodes; ++node) {
      Eigen::Quaterniond& rotation = estimates[node];
      rotation = (rotation * ExpRotation(steps.row(node))).normalized();
    }
  };
  GraphLaplacianSolver solver(num_nodes, edges, fixed_node);
  if (!AverageReweighted(
          options,
          edges,
          stddevs,
          weights,
          TrustInTriangles(num_closing_triangles),
          [&]() { return ComputeResiduals(relatives, estimates); },
          apply_steps,
          &solver)) {
    return false;
  }
  // The fixed node's start is handed back bit by bit.
  if (has_start) estimates[fixed_node] = (*rotations)[fixed_node];
  *rotations = std::move(estimates);
  return true;
}

}  // namespace dgsfm
