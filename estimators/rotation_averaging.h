// Global rotations from relative ones: L1 then iteratively reweighted least
// squares on the tangent space (Chatterjee and Govindu 2013, as in GLOMAP).

#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

// cam2_from_cam1 rotation of a pair of nodes: R_2 = cam2_from_cam1 * R_1.
struct RelativeRotation {
  int node1 = 0;
  int node2 = 0;
  Eigen::Quaterniond cam2_from_cam1 = Eigen::Quaterniond::Identity();
  // Weight of the squared residual [1], > 0.
  double weight = 1;
};

struct RotationAveragingOptions {
  int max_num_l1_iterations = 5;
  int max_num_irls_iterations = 100;
  // Mean step below which a phase has converged [rad].
  double step_convergence_threshold_rad = 1e-4;
  // Scale of the Geman-McClure loss of the IRLS phase [deg].
  double loss_scale_deg = 5.0;

  bool IsValid(std::string* error) const;
};

// cam_from_world rotations of all nodes of a connected graph.
// Minimises sum_e w_e rho(|log(R_2^T R_21 R_1)|), gauge: the rotation of
// `fixed_node` stays at its start value. The start is `rotations` if it has
// num_nodes entries, else a maximum spanning tree by weight from fixed_node
// (identity there). Returns false, rotations unchanged, if the graph is not
// connected or a factorisation fails even after the LDLT fallback.
// Deterministic; one sparse Cholesky (CHOLMOD via Eigen) per IRLS iteration.
[[nodiscard]] bool AverageRotations(
    int num_nodes,
    const std::vector<RelativeRotation>& relative_rotations,
    int fixed_node,
    const RotationAveragingOptions& options,
    std::vector<Eigen::Quaterniond>* rotations);

}  // namespace dgsfm
