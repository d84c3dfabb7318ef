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
  // Reweighted least-squares steps of the L1 phase, which has to undo outlier
  // edges in the start: on 50 nodes with 30 % random edges, 5 steps fail in 4
  // of 5 graphs, 20 in none; 40 % at degree 20 wants 50.
  int max_num_l1_iterations = 50;
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
// connected or a factorisation fails even after the LDLT fallback. Throws on
// self-loops, nodes out of range, weights that are not finite and positive and
// rotations that are no unit quaternions.
// Deterministic; one sparse Cholesky (CHOLMOD via Eigen) per iteration. The L1
// phase minimises the sum of angles, not of the axes' components as in the
// source, which makes it independent of the choice of the world frame.
[[nodiscard]] bool AverageRotations(
    int num_nodes,
    const std::vector<RelativeRotation>& relative_rotations,
    int fixed_node,
    const RotationAveragingOptions& options,
    std::vector<Eigen::Quaterniond>* rotations);

}  // namespace dgsfm
