// Global rotations from relative ones: L1 then iteratively reweighted least
// squares on the tangent space (Chatterjee and Govindu 2013, as in GLOMAP).

#pragma once

#include "estimators/averaging/graph_averaging.h"

#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

// cam2_from_cam1 rotation of a pair of nodes: R_2 = cam2_from_cam1 * R_1.
struct RelativeRotation {
  int node1 = 0;
  int node2 = 0;
  Eigen::Quaterniond cam2_from_cam1 = Eigen::Quaterniond::Identity();
  // Standard deviation of each component of the angle-axis vector [rad], > 0.
  double stddev_rad = 5.0 / 3 * M_PI / 180;
  // What the edge counts [1], > 0.
  double weight = 1;
};

// cam_from_world rotations of all nodes of a connected graph: minimises
// sum_e weight_e rho(|log(R_2^T R_21 R_1)| / stddev_e) by AverageReweighted,
// gauge: the
// rotation of fixed_node stays at its start value. The start is `rotations` if
// it has num_nodes entries, else the spanning tree (identity at fixed_node) of
// the edges that close most triangles, times weight; edges that close none
// count a tenth in the L1 phase. The L1 phase minimises the sum of angles, not
// of the axes' components as in the source, which makes it independent of the
// choice of the world frame. Returns false, rotations unchanged, if the graph
// is not connected or the linear solver fails. Throws on self-loops, nodes out
// of range, standard deviations that are not finite and positive and rotations
// that are not unit quaternions. Deterministic.
[[nodiscard]] bool AverageRotations(
    int num_nodes,
    const std::vector<RelativeRotation>& relative_rotations,
    int fixed_node,
    const GraphAveragingOptions& options,
    std::vector<Eigen::Quaterniond>* rotations);

}  // namespace dgsfm
