#include "estimators/rotation_averaging.h"

#include "colmap_ext/check.h"
#include "estimators/graph.h"
#include "estimators/graph_laplacian.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// Residuals below this count as zero in the L1 phase [rad].
constexpr double kL1Floor = 1e-4;

// Angle-axis vector of a rotation, angle in [0, pi]; stable at both ends.
Eigen::Vector3d LogRotation(const Eigen::Quaterniond& rotation) {
  const double sine = rotation.vec().norm();
  const double sign = rotation.w() < 0 ? -1 : 1;
  // atan2(x, 1) / x is 1 to the last bit here.
  if (sine < 1e-10) return 2 * sign * rotation.vec();
  const double half_angle = std::atan2(sine, std::abs(rotation.w()));
  return (2 * sign * half_angle / sine) * rotation.vec();
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

// With R_i <- R_i exp(x_i), the residual e = log(R_2^T R_21 R_1) changes by
// x_1 - x_2 to first order. The exact derivative has the same gradient, for e
// is an eigenvector of its own Jacobian: fixed points are minima.
bool RefineRotations(const std::vector<RelativeRotation>& relatives,
                     const Eigen::VectorXd& edge_weights,
                     const RotationAveragingOptions& options,
                     GraphLaplacianSolver* solver,
                     std::vector<Eigen::Quaterniond>* estimates) {
  const auto compute_residuals = [&]() {
    Eigen::MatrixXd residuals(relatives.size(), 3);
    for (size_t e = 0; e < relatives.size(); ++e) {
      residuals.row(e) = LogRotation(
          (*estimates)[relatives[e].node2].conjugate() *
          relatives[e].cam2_from_cam1 * (*estimates)[relatives[e].node1]);
    }
    return residuals;
  };
  const auto apply_steps = [&](const Eigen::MatrixXd& steps) {
    for (size_t node = 0; node < estimates->size(); ++node) {
      Eigen::Quaterniond& rotation = (*estimates)[node];
      rotation = (rotation * ExpRotation(steps.row(node))).normalized();
    }
  };
  const ReweightingPhase l1_phase{L1Weight(kL1Floor),
                                  options.max_num_l1_iterations,
                                  options.step_convergence_threshold_rad};
  const ReweightingPhase irls_phase{
      GemanMcClureWeight(options.loss_scale_deg * M_PI / 180),
      options.max_num_irls_iterations,
      options.step_convergence_threshold_rad};
  for (const ReweightingPhase& phase : {l1_phase, irls_phase}) {
    if (!SolveReweighted(
            phase, edge_weights, compute_residuals, apply_steps, solver)) {
      return false;
    }
  }
  return true;
}

}  // namespace

bool RotationAveragingOptions::IsValid(std::string* error) const {
  return CheckOption(max_num_l1_iterations >= 0,
                     "max_num_l1_iterations must be >= 0",
                     max_num_l1_iterations,
                     error) &&
         CheckOption(max_num_irls_iterations >= 0,
                     "max_num_irls_iterations must be >= 0",
                     max_num_irls_iterations,
                     error) &&
         CheckOption(step_convergence_threshold_rad >= 0,
                     "step_convergence_threshold_rad must be >= 0",
                     step_convergence_threshold_rad,
                     error) &&
         CheckOption(loss_scale_deg > 0,
                     "loss_scale_deg must be > 0",
                     loss_scale_deg,
                     error);
}

bool AverageRotations(int num_nodes,
                      const std::vector<RelativeRotation>& relative_rotations,
                      int fixed_node,
                      const RotationAveragingOptions& options,
                      std::vector<Eigen::Quaterniond>* rotations) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  std::vector<RelativeRotation> relatives = relative_rotations;
  std::vector<GraphEdge> edges;
  std::vector<double> weights;
  for (RelativeRotation& relative : relatives) {
    DGSFM_CHECK(relative.node1 != relative.node2)
        << "self-loop at node " << relative.node1;
    DGSFM_CHECK(std::isfinite(relative.weight) && relative.weight > 0)
        << "weight = " << relative.weight;
    relative.cam2_from_cam1 = NormalizedChecked(relative.cam2_from_cam1);
    edges.emplace_back(relative.node1, relative.node2);
    weights.push_back(relative.weight);
  }
  const SpanningTree tree =
      MaximumSpanningTree(num_nodes, edges, weights, fixed_node);
  if (static_cast<int>(tree.order.size()) < num_nodes) return false;

  std::vector<Eigen::Quaterniond> estimates;
  const bool has_start = static_cast<int>(rotations->size()) == num_nodes;
  if (has_start) {
    for (const Eigen::Quaterniond& rotation : *rotations) {
      estimates.push_back(NormalizedChecked(rotation));
    }
  } else {
    estimates = ChainAlongTree(relatives, tree);
  }
  const Eigen::VectorXd edge_weights =
      Eigen::Map<const Eigen::VectorXd>(weights.data(), weights.size());
  GraphLaplacianSolver solver(num_nodes, edges, fixed_node);
  if (!RefineRotations(relatives, edge_weights, options, &solver, &estimates)) {
    return false;
  }
  // The fixed node's start is handed back bit by bit.
  if (has_start) estimates[fixed_node] = (*rotations)[fixed_node];
  *rotations = std::move(estimates);
  return true;
}

}  // namespace dgsfm
