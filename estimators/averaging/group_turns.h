// Rotations of lower cost by turning groups of nodes as a whole.
//
// Where two places look alike, pairs across them contradict the pairs along the
// way from one to the other. Averages then keep the many and cut the few, and
// from there no step that is small leads to the other explanation: a whole part
// of the graph has to turn.

#pragma once

#include "estimators/averaging/rotation_averaging.h"

#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

// Relative rotation with what the two verdicts on it cost [nat], >= 0.
struct JudgedRotation {
  RelativeRotation relative;
  double cost_if_kept = 0;
  double cost_if_outlier = 0;
};

// Whether the cam_from_world rotations of the nodes are off by more than
// max_error_rad from each of the relative ones.
std::vector<char> FindOutliers(
    const std::vector<JudgedRotation>& judged,
    double max_error_rad,
    const std::vector<Eigen::Quaterniond>& rotations);

// Sum of the costs of all verdicts that the rotations imply [nat].
double CostOfRotations(const std::vector<JudgedRotation>& judged,
                       double max_error_rad,
                       const std::vector<Eigen::Quaterniond>& rotations);

// Rotations whose cost is lower than that of the given ones, or the given ones.
// Moves start from these and from a spanning tree of the edges with most
// evidence. Each move turns the nodes of a group by one rotation T about the
// axes of the world, R_i <- R_i T, and then averages the edges that are no
// outliers. T makes an outlier right that is off by at least three times
// max_error_rad. The group grows from its second node by the node that lowers
// the cost most or raises it least (Fiduccia and Mattheyses 1982, without their
// balance). Gauge: the rotation of fixed_node stays. Deterministic.
std::vector<Eigen::Quaterniond> TurnGroups(
    const std::vector<JudgedRotation>& judged,
    double max_error_rad,
    int fixed_node,
    const GraphAveragingOptions& averaging,
    const std::vector<Eigen::Quaterniond>& rotations);

}  // namespace dgsfm
