// Smooth errors of depth maps.
//
// Errors of depth networks vary slowly over the image, so that those of nearby
// points are not independent. The low orders of log depth,
//   log depth = log true depth + c . phi(x / unit), phi = (x, y, x2, xy, y2),
// are therefore parameters of the refinement, with a Gaussian prior on each
// coefficient. (Order 0 is the scale of the map.)

#pragma once

#include <Eigen/Core>

namespace dgsfm {

constexpr int kNumDepthFieldTerms = 5;

using DepthFieldBasis = Eigen::Matrix<double, kNumDepthFieldTerms, 1>;
// The coefficients of map 1, then those of map 2.
using DepthFields = Eigen::Matrix<double, 2 * kNumDepthFieldTerms, 1>;

// phi at a point in units in which the image is of order one.
inline DepthFieldBasis EvaluateDepthFieldBasis(const Eigen::Vector2d& x) {
  DepthFieldBasis basis;
  basis << x, x.x() * x.x(), x.x() * x.y(), x.y() * x.y();
  return basis;
}

}  // namespace dgsfm
