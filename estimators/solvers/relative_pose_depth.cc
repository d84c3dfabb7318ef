#include "estimators/solvers/relative_pose_depth.h"

#include "estimators/solvers/polynomial.h"

#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace dgsfm {
namespace {

// The corners of the sides of a triangle.
constexpr int kCorners[3][2] = {{0, 1}, {0, 2}, {1, 2}};

using Triangle = std::array<Eigen::Vector3d, 3>;

// Corners at scale * depth * (x / focal, 1).
Triangle LiftTriangle(const std::array<Eigen::Vector2d, 3>& points,
                      const std::array<double, 3>& depths,
                      double focal,
                      double scale) {
  Triangle triangle;
  for (int i = 0; i < 3; ++i) {
    const double depth = scale * depths[i];
    triangle[i] << points[i] * (depth / focal), depth;
  }
  return triangle;
}

// Columns: along the first side, in the plane, along the normal. False if the
// triangle is a line: its normal would be mostly rounding or noise.
bool TriangleFrame(const Triangle& triangle, Eigen::Matrix3d* frame) {
  // Sine of the angle at the first corner.
  constexpr double kMinSine = 1e-6;
  const Eigen::Vector3d side12 = triangle[1] - triangle[0];
  const Eigen::Vector3d side13 = triangle[2] - triangle[0];
  const Eigen::Vector3d normal = side12.cross(side13);
  const double sq_length = side12.squaredNorm();
  const double sq_normal = normal.squaredNorm();
  if (!(sq_normal > kMinSine * kMinSine * sq_length * side13.squaredNorm())) {
    return false;
  }
  frame->col(0) = (1 / std::sqrt(sq_length)) * side12;
  frame->col(2) = (1 / std::sqrt(sq_normal)) * normal;
  frame->col(1) = frame->col(2).cross(frame->col(0));
  return true;
}

// The motion of triangle 1 onto triangle 2 by their frames and centroids: a
// proper rotation even if their sides differ.
bool AlignTriangles(const Triangle& triangle1,
                    const Triangle& triangle2,
                    Eigen::Matrix3d* rotation,
                    Eigen::Vector3d* translation) {
  Eigen::Matrix3d frame1, frame2;
  if (!TriangleFrame(triangle1, &frame1) ||
      !TriangleFrame(triangle2, &frame2)) {
    return false;
  }
  *rotation = frame2 * frame1.transpose();
  *translation =
      (1.0 / 3) * (triangle2[0] + triangle2[1] + triangle2[2] -
                   *rotation * (triangle1[0] + triangle1[1] + triangle1[2]));
  return true;
}

// Adds the model that moves triangle 1 onto triangle 2.
void AddAligned(const Triangle& triangle1,
                const Triangle& triangle2,
                double scale,
                double focal1,
                double focal2,
                TwoViewModels* models) {
  TwoViewModel model;
  if (!AlignTriangles(
          triangle1, triangle2, &model.rotation, &model.translation)) {
    return;
  }
  model.scale = scale;
  model.focal1 = focal1;
  model.focal2 = focal2;
  if (model.IsFinite()) models->Add(model);
}

// The coefficients of (E_k) in units in which depths and points are of order
// one: mixed units would ruin pivots and tolerances.
struct SideEquations {
  double depth_unit1 = 0;
  double depth_unit2 = 0;
  double point_unit1 = 0;
  double point_unit2 = 0;
  DepthTriplet triplet;                  // in these units
  std::array<double, 3> g1, h1, g2, h2;  // sides 12, 13, 23

  SideEquations(const DepthTriplet& in, bool shared_point_unit) {
    for (int i = 0; i < 3; ++i) {
      depth_unit1 += in.depths1[i] / 3;
      depth_unit2 += in.depths2[i] / 3;
      point_unit1 += in.points1[i].norm() / 3;
      point_unit2 += in.points2[i].norm() / 3;
    }
    if (shared_point_unit) {
      point_unit1 = point_unit2 = (point_unit1 + point_unit2) / 2;
    }
    const Eigen::Vector4d factors =
        Eigen::Vector4d(point_unit1, point_unit2, depth_unit1, depth_unit2)
            .cwiseInverse();
    for (int i = 0; i < 3; ++i) {
      triplet.points1[i] = in.points1[i] * factors(0);
      triplet.points2[i] = in.points2[i] * factors(1);
      triplet.depths1[i] = in.depths1[i] * factors(2);
      triplet.depths2[i] = in.depths2[i] * factors(3);
    }
    for (int k = 0; k < 3; ++k) {
      const auto [i, j] = kCorners[k];
      Coefficients(triplet.points1, triplet.depths1, i, j, &g1[k], &h1[k]);
      Coefficients(triplet.points2, triplet.depths2, i, j, &g2[k], &h2[k]);
    }
  }

  static void Coefficients(const std::array<Eigen::Vector2d, 3>& points,
                           const std::array<double, 3>& depths,
                           int i,
                           int j,
                           double* g,
                           double* h) {
    *g = (depths[i] * points[i] - depths[j] * points[j]).squaredNorm();
    *h = (depths[i] - depths[j]) * (depths[i] - depths[j]);
  }

  // Adds the model with these unknowns of (E_k), in these units, if they are
  // positive.
  void AddModel(double phi,
                double sq_scale_times_psi,
                double sq_scale,
                TwoViewModels* models) const {
    const double psi = sq_scale_times_psi / sq_scale;
    if (!(phi > 0 && psi > 0 && sq_scale > 0)) return;
    const double scale = std::sqrt(sq_scale) * depth_unit1;
    const double focal1 = 1 / std::sqrt(phi);
    const double focal2 = 1 / std::sqrt(psi);
    AddAligned(
        LiftTriangle(triplet.points1, triplet.depths1, focal1, depth_unit1),
        LiftTriangle(triplet.points2, triplet.depths2, focal2, scale),
        scale / depth_unit2,
        focal1 * point_unit1,
        focal2 * point_unit2,
        models);
  }
};

// Gauss-Newton on the three law-of-cosines equations of P3P.
void PolishDepths(const Eigen::Matrix3d& dots,
                  const Eigen::Vector3d& sq_sides,
                  Eigen::Vector3d* z) {
  for (int step = 0; step < 2; ++step) {
    Eigen::Vector3d residual;
    Eigen::Matrix3d J = Eigen::Matrix3d::Zero();
    for (int k = 0; k < 3; ++k) {
      const auto [i, j] = kCorners[k];
      const double zi = (*z)(i);
      const double zj = (*z)(j);
      residual(k) = zi * zi * dots(i, i) + zj * zj * dots(j, j) -
                    2 * zi * zj * dots(i, j) - sq_sides(k);
      J(k, i) = 2 * (zi * dots(i, i) - zj * dots(i, j));
      J(k, j) = 2 * (zj * dots(j, j) - zi * dots(i, j));
    }
    const Eigen::Vector3d dz = J.inverse() * residual;
    // Singular on the danger cylinder: the closed form is then as good.
    if (!(dz.norm() < 0.1 * z->norm())) return;
    *z -= dz;
  }
}

// Newton on the three sides for (phi, s^2, b_3); m are products of the image
// points of view 2.
void PolishSharedFocal(const SideEquations& sides,
                       double m3,
                       double m13,
                       double m23,
                       Eigen::Vector3d* unknowns) {
  const auto& y = sides.triplet.points2;
  const double m[2] = {m13, m23};
  const double phi = (*unknowns)(0);
  const double sq_scale = (*unknowns)(1);
  const double depth3 = (*unknowns)(2);
  Eigen::Vector3d residual;
  Eigen::Matrix3d jacobian;
  const double side12 = sides.g2[0] * phi + sides.h2[0];
  residual(0) = sides.g1[0] * phi + sides.h1[0] - sq_scale * side12;
  jacobian.row(0) << sides.g1[0] - sq_scale * sides.g2[0], -side12, 0;
  for (int k = 0; k < 2; ++k) {
    const double b = sides.triplet.depths2[k];
    const double g = b * b * y[k].squaredNorm() - 2 * b * depth3 * m[k] +
                     depth3 * depth3 * m3;
    const double side = g * phi + (b - depth3) * (b - depth3);
    residual(k + 1) = sides.g1[k + 1] * phi + sides.h1[k + 1] - sq_scale * side;
    jacobian.row(k + 1) << sides.g1[k + 1] - sq_scale * g, -side,
        -2 * sq_scale * ((depth3 * m3 - b * m[k]) * phi + depth3 - b);
  }
  const Eigen::Vector3d change = jacobian.inverse() * residual;
  // Near a double root the closed form is as good.
  if (change.norm() < 0.1 * unknowns->norm()) *unknowns -= change;
}

}  // namespace

TwoViewModels SolveP3PScale(const DepthTriplet& triplet) {
  TwoViewModels models;
  const Triangle triangle1 =
      LiftTriangle(triplet.points1, triplet.depths1, 1, 1);
  const Eigen::Vector3d sq_sides((triangle1[0] - triangle1[1]).squaredNorm(),
                                 (triangle1[0] - triangle1[2]).squaredNorm(),
                                 (triangle1[1] - triangle1[2]).squaredNorm());
  Eigen::Matrix3d rays;
  for (int i = 0; i < 3; ++i) rays.col(i) = triplet.points2[i].homogeneous();
  const Eigen::Matrix3d dots = rays.transpose() * rays;

  // Depth ratios u = z2 / z1, v = z3 / z1; the sides 12 : 13 : 23 give
  //   A = m11 + m22 u^2 - 2 m12 u,  d12 (m11 + m33 v^2 - 2 m13 v) = d13 A,
  //   d12 (m22 u^2 + m33 v^2 - 2 m23 u v) = d23 A.
  // Their difference is linear in v = P(u) / Q(u), the first then quartic.
  const double d12 = sq_sides(0);
  const double d13 = sq_sides(1);
  const double d23 = sq_sides(2);
  const Polynomial<3> A = {dots(0, 0), -2 * dots(0, 1), dots(1, 1)};
  const Polynomial<3> P =
      (d23 - d13) * A + Polynomial<3>{d12 * dots(0, 0), 0, -d12 * dots(1, 1)};
  const Polynomial<2> Q = {2 * d12 * dots(0, 2), -2 * d12 * dots(1, 2)};
  const Polynomial<3> QQ = Q * Q;
  const Polynomial<5> quartic =
      QQ * (Polynomial<3>{d12 * dots(0, 0), 0, 0} - d13 * A) +
      (d12 * dots(2, 2)) * (P * P) +
      (-2 * d12 * dots(0, 2)) * (P * Q * Polynomial<2>{1, 0});
  const auto roots = FindRealRoots(quartic);
  for (int i = 0; i < roots.count; ++i) {
    const double u = roots.values[i];
    const double v = Evaluate(P, u) / Evaluate(Q, u);
    const double ratio = Evaluate(A, u);
    if (!(u > 0 && v > 0 && ratio > 0)) continue;
    Eigen::Vector3d z = std::sqrt(d12 / ratio) * Eigen::Vector3d(1, u, v);
    PolishDepths(dots, sq_sides, &z);
    if (!(z.minCoeff() > 0)) continue;
    double log_scale = 0;
    Triangle triangle2;
    for (int k = 0; k < 3; ++k) {
      triangle2[k] = z(k) * rays.col(k);
      log_scale += std::log(z(k) / triplet.depths2[k]) / 3;
    }
    AddAligned(triangle1, triangle2, std::exp(log_scale), 1, 1, &models);
  }
  return models;
}

TwoViewModels SolveTwoFocals(const DepthTriplet& triplet) {
  const SideEquations sides(triplet, /*shared_point_unit=*/false);
  Eigen::Matrix3d coefficients;
  Eigen::Vector3d constants;
  for (int k = 0; k < 3; ++k) {
    coefficients.row(k) << sides.g1[k], -sides.g2[k], -sides.h2[k];
    constants(k) = -sides.h1[k];
  }
  const Eigen::Vector3d solution = coefficients.inverse() * constants;
  TwoViewModels models;
  sides.AddModel(solution(0), solution(1), solution(2), &models);
  return models;
}

TwoViewModels SolveOneSidedFocal(const DepthTriplet& triplet) {
  const SideEquations sides(triplet, /*shared_point_unit=*/false);
  const double phi = sides.point_unit1 * sides.point_unit1;
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector2d row = Eigen::Vector2d(sides.g2[k], sides.h2[k]) /
                                (sides.g1[k] * phi + sides.h1[k]);
    normal += row * row.transpose();
    right += row;
  }
  const Eigen::Vector2d solution = normal.inverse() * right;
  TwoViewModels models;
  sides.AddModel(phi, solution(0), solution(1), &models);
  return models;
}

TwoViewModels SolveSharedFocal(const DepthTriplet& triplet) {
  SideEquations sides(triplet, /*shared_point_unit=*/true);
  const auto& y = sides.triplet.points2;
  const double b1 = sides.triplet.depths2[0];
  const double b2 = sides.triplet.depths2[1];
  const double m1 = y[0].squaredNorm();
  const double m2 = y[1].squaredNorm();
  const double m3 = y[2].squaredNorm();
  const double m13 = y[0].dot(y[2]);
  const double m23 = y[1].dot(y[2]);

  // Unknowns phi and Y = b_3. s^2 = L / M from E_12; with it
  //   E_13: (g13 phi + h13) M = L |Y_1 - Y_3|^2, likewise E_23;
  // their difference gives Y = N / (L D).
  const Polynomial<2> L = {sides.h1[0], sides.g1[0]};
  const Polynomial<2> M = {sides.h2[0], sides.g2[0]};
  const Polynomial<2> E13 = {sides.h1[1], sides.g1[1]};
  const Polynomial<2> E23 = {sides.h1[2], sides.g1[2]};
  const Polynomial<2> sq_range1 = {b1 * b1, b1 * b1 * m1};
  const Polynomial<2> sq_range2 = {b2 * b2, b2 * b2 * m2};
  const Polynomial<2> D = {2 * (b1 - b2), 2 * (b1 * m13 - b2 * m23)};
  const Polynomial<3> N = L * (sq_range1 - sq_range2) - M * (E13 - E23);
  const Polynomial<3> LD = L * D;
  const Polynomial<6> quintic = LD * (E13 * M * D - sq_range1 * LD) +
                                (2 * b1) * (N * LD * Polynomial<2>{1, m13}) -
                                N * N * Polynomial<2>{1, m3};
  // phi = 0 is always a root (infinite focal length): divide it out.
  const auto roots = FindRealRoots(Polynomial<5>{
      quintic[1], quintic[2], quintic[3], quintic[4], quintic[5]});
  TwoViewModels models;
  for (int i = 0; i < roots.count; ++i) {
    const double phi = roots.values[i];
    const double sq_scale = Evaluate(L, phi) / Evaluate(M, phi);
    Eigen::Vector3d unknowns(
        phi, sq_scale, Evaluate(N, phi) / Evaluate(LD, phi));
    if (!(unknowns.minCoeff() > 0)) continue;
    PolishSharedFocal(sides, m3, m13, m23, &unknowns);
    if (!(unknowns(2) > 0)) continue;
    sides.triplet.depths2[2] = unknowns(2);
    sides.AddModel(
        unknowns(0), unknowns(1) * unknowns(0), unknowns(1), &models);
  }
  return models;
}

}  // namespace dgsfm
