// The average of rotations that share one value but for noise and outliers.

#pragma once

#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

// Geodesic median of at least one rotation (the L1 mean of Hartley, Aftab and
// Trumpf, "L1 rotation averaging using the Weiszfeld algorithm", 2011) by
// reweighted means of quaternions: less than half of the rotations may be
// arbitrarily wrong.
Eigen::Quaterniond MedianRotation(
    const std::vector<Eigen::Quaterniond>& rotations);

}  // namespace dgsfm
