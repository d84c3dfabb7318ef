// An order in which neighbours in space mostly follow each other.

#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Indices of the positions along a Z-order curve. The curve covers a cube
// around all positions but a few that are far off, whose coordinates are
// clamped to it. The first of equal ones comes first.
std::vector<size_t> OrderAlongCurve(
    const std::vector<Eigen::Vector3d>& positions);

}  // namespace dgsfm
