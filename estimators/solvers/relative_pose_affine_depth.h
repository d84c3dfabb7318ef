// Minimal solvers for the relative pose of two views from matches whose depths
// are known up to scale and shift: true depth = scale * (depth + shift), the
// shift of view 1 being u, that of view 2 v, and scale 1 in view 1. Otherwise
// as relative_pose_depth.h; the sides of the triangles give, for pairs k = ij,
//   (A_k u^2 + B_k u + C_k) phi + h_k =
//       s^2 ((A'_k v^2 + B'_k v + C'_k) psi + h'_k)                    (E_k)
//   A_ij = |x_i - x_j|^2,  B_ij = 2 (x_i - x_j).(a_i x_i - a_j x_j),
//   C_ij = |a_i x_i - a_j x_j|^2,  h_ij = (a_i - a_j)^2.
// Solutions have positive scale, focal lengths and shifted depths. Equal depths
// in a view leave its scale and shift apart undetermined: finite solutions or
// none. No allocation.
//
// Source: own derivation of the problems posed in [Ding 2025, RePoseD].

#pragma once

#include "estimators/solvers/relative_pose_depth.h"

namespace dgsfm {

struct AffineDepthModel {
  TwoViewModel model;
  double shift1 = 0;  // [unit of depth map 1]
  double shift2 = 0;  // [unit of depth map 2]
};

struct AffineDepthModels {
  int count = 0;
  std::array<AffineDepthModel, 4> values;
};

// Four matches.
struct DepthQuadruple {
  std::array<Eigen::Vector2d, 4> points1;
  std::array<Eigen::Vector2d, 4> points2;
  std::array<double, 4> depths1;
  std::array<double, 4> depths2;
};

// Calibrated, points divided by the focal lengths: three (E_k) are linear in
// s^2 (v^2, v, 1), which makes the identity of its entries a quartic in u. At
// most 4 solutions.
AffineDepthModels SolveCalibratedAffine(const DepthTriplet& triplet);

// Both focal lengths unknown: five (E_k) (34 is not used) are linear in
// (u^2, u, 1) phi, s^2 psi (v^2, v, 1) and s^2; the identities of the first two
// triples are two conics in the two-dimensional solution space, which intersect
// at the roots of a quartic. At most 4 solutions.
AffineDepthModels SolveTwoFocalsAffine(const DepthQuadruple& quadruple);

}  // namespace dgsfm
