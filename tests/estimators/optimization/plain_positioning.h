// Global positioning in its plain formulation, by Ceres: an oracle.

#pragma once

#include "estimators/optimization/global_positioning.h"
#include "estimators/optimization/point_minimizer.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Minimises sum w rho(|d - alpha (X - c)|^2) over the centres c except that of
// fixed_camera, the points X and one scale alpha >= 0 an observation (DGSfM Eq.
// 17), which start at their best. For a contract see SolveGlobalPositioning.
PointMinimizerSummary MinimizeWithScales(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points);

}  // namespace dgsfm
