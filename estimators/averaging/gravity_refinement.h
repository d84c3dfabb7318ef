// Averaged rotations refined by gravity.

#pragma once

#include "estimators/averaging/graph_averaging.h"
#include "estimators/averaging/rotation_averaging.h"

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

struct NodeGravity {
  int node = 0;
  // Unit vector downwards in the frame of the node.
  Eigen::Vector3d in_node = Eigen::Vector3d::UnitY();
  // What it counts [1], > 0.
  double weight = 1;
};

struct GravityRefinementOptions {
  // Whether gravity refines rotations.
  bool use_gravity = false;
  // Standard deviation of gravity about each horizontal axis; a larger one that
  // the data show counts in its place [deg].
  double stddev_deg = 1;

  bool IsValid(std::string* error) const;
};

// Minimises, over the rotations and the common vertical, the loss of
// AverageRotations' last phase plus the same loss of
//   |node_from_world * down - in_node| / stddev.
// Both count by the noise that the data show: what pairs are off at the start
// gives the factor of their standard deviations, and the median deviation from
// the vertical that of gravity, once more while it shrinks. The start is an
// average of rotations, whose fixed_node keeps its rotation. Returns false,
// rotations unchanged, if fewer than three have gravity, if these do not agree
// on a vertical (FindUpDirection), or if the solver fails. Deterministic.
[[nodiscard]] bool RefineByGravity(
    const GravityRefinementOptions& options,
    const GraphAveragingOptions& averaging,
    const std::vector<RelativeRotation>& relative_rotations,
    const std::vector<NodeGravity>& gravities,
    int fixed_node,
    std::vector<Eigen::Quaterniond>* node_from_world);

}  // namespace dgsfm
