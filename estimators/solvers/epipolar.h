// Epipolar geometry without depth: fundamental matrices from seven matches,
// what poses and focal lengths they stand for, depths along viewing rays.

#pragma once

#include "estimators/solvers/epipolar_lanes.h"
#include "estimators/two_view/two_view_model.h"

#include <array>
#include <optional>

#include <Eigen/Core>

namespace dgsfm {

// (x2, 1)^T F (x1, 1) = 0 from seven matches: det = 0 on the pencil of the two
// null vectors of the linear system, at most 3 solutions of unit norm for each
// of eight samples. Points should be of order one. Degenerate: the points, or
// six of them, in a plane. Source: [Hartley and Zisserman 2004, Sec. 11.1.2].
using FundamentalMatrices = EpipolarMatrices<3>;
std::array<FundamentalMatrices, kNumLanes> SolveSevenPoints(
    const SampleLanes<7>& samples);

// The four poses of an essential matrix (any scale, nearest one in the
// Frobenius norm), with unit translations: rotations[0] or [1] with plus or
// minus the translation.
struct EssentialPoses {
  std::array<Eigen::Matrix3d, 2> rotations;
  Eigen::Vector3d translation;
};
EssentialPoses DecomposeEssentialMatrix(const Eigen::Matrix3d& E);

// How far diag(f2, f2, 1) F diag(f1, f1, 1) is from an essential matrix:
// ((s1^2 - s2^2) / (s1^2 + s2^2))^2 for its singular values s1, s2, in [0, 1].
double EssentialMatrixDefect(const Eigen::Matrix3d& F,
                             double focal1,
                             double focal2);

// Where the viewing rays of a match come closest.
struct RayIntersection {
  double depth1 = 0;  // z-depth in frame 1
  double depth2 = 0;  // z-depth in frame 2
  double angle_rad = 0;
};
// Nothing if the rays are parallel or meet behind a camera.
std::optional<RayIntersection> IntersectRays(const TwoViewModel& model,
                                             const Eigen::Vector2d& x1,
                                             const Eigen::Vector2d& x2);

}  // namespace dgsfm
