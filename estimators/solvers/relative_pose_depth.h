// Minimal solvers for the relative pose of two views from three matches with
// z-depth. No allocation; solutions come in a fixed-size array.
//
// Unknown besides rotation R and translation t: the scale s of depth map 2
// relative to map 1, and none, one (shared or one-sided) or both focal
// lengths. With X_i = a_i (x_i / f1, 1) and Y_i = s b_i (y_i / f2, 1) for
// depths a_i, b_i and image points x_i, y_i relative to the principal points,
// a rigid motion keeps the sides of the triangle, for k = 12, 13, 23:
//   g_k phi + h_k = s^2 (g'_k psi + h'_k)                              (E_k)
//   g_ij = |a_i x_i - a_j x_j|^2,  h_ij = (a_i - a_j)^2,
//   phi = 1 / f1^2,  psi = 1 / f2^2,  primes for view 2.
// R and t follow from orthonormal frames on the two triangles.
//
// Depths must be positive and everything finite. Solutions have s, focal
// lengths and all depths positive. Collinear points, and what each solver
// lists, give no solution or an arbitrary finite one.
//
// Source: own derivation of the problems posed in [Ding 2025, RePoseD].

#pragma once

#include "estimators/two_view/two_view_model.h"

#include <array>

#include <Eigen/Core>

namespace dgsfm {

// Three matches. Image points in pixels relative to the principal points, or
// divided by the focal length where that is known (then f1 = f2 = 1 in E_k).
struct DepthTriplet {
  std::array<Eigen::Vector2d, 3> points1;
  std::array<Eigen::Vector2d, 3> points2;
  std::array<double, 3> depths1;
  std::array<double, 3> depths2;

  DepthTriplet Swapped() const { return {points2, points1, depths2, depths1}; }
};

struct TwoViewModels {
  int count = 0;
  std::array<TwoViewModel, 4> values;

  void Add(const TwoViewModel& model) { values[count++] = model; }
};

// Calibrated: P3P of the triangle in view 1 against the rays of view 2, then
// log s = mean log(z_i / b_i) over the depths z_i in view 2. Two of the depth
// constraints of view 2 are used only for s. At most 4 solutions. Degenerate
// as P3P: camera 2 on the cylinder through the triangle's circumcircle.
// Points normalised by the focal lengths; focal lengths of the solutions are 1.
TwoViewModels SolveP3PScale(const DepthTriplet& triplet);

// Both focal lengths unknown: (E_k) is linear in phi, s^2 psi and s^2. One
// solution at most. Degenerate: equal depths in a view, pure translation,
// rotation about the optical axis only.
TwoViewModels SolveTwoFocals(const DepthTriplet& triplet);

// Focal length 2 unknown, points1 normalised by focal length 1: (E_k) is
// linear in s^2 psi and s^2, least squares of three equations each divided by
// its left side. One solution at most. Degenerate: equal depths in view 2.
TwoViewModels SolveOneSidedFocal(const DepthTriplet& triplet);

// The same unknown focal length in both views: with s^2 eliminated by E_12 and
// the depth b_3 by E_13 - E_23, E_13 is a quartic in phi. b_3 is not used. At
// most 4 solutions. Degenerate: pure translation, rotation about the optical
// axis only.
TwoViewModels SolveSharedFocal(const DepthTriplet& triplet);

}  // namespace dgsfm
