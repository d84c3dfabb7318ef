#include "estimators/solvers/relative_pose_affine_depth.h"

#include "estimators/solvers/polynomial.h"
#include "estimators/solvers/triangle_alignment.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/LU>
#include <Eigen/QR>

namespace dgsfm {
namespace {

// One view in units in which depths and points are of order one.
template <size_t N>
struct UnitView {
  double depth_unit = 0;
  double point_unit = 0;
  std::array<Eigen::Vector2d, N> points;
  std::array<double, N> depths;

  UnitView(const std::array<Eigen::Vector2d, N>& points_in,
           const std::array<double, N>& depths_in) {
    for (size_t i = 0; i < N; ++i) {
      depth_unit += depths_in[i] / N;
      point_unit += points_in[i].norm() / N;
    }
    for (size_t i = 0; i < N; ++i) {
      points[i] = points_in[i] / point_unit;
      depths[i] = depths_in[i] / depth_unit;
    }
  }

  // A, B, C and h of a pair.
  Eigen::Vector4d Coefficients(int i, int j) const {
    const Eigen::Vector2d a = points[i] - points[j];
    const Eigen::Vector2d b = depths[i] * points[i] - depths[j] * points[j];
    const double dz = depths[i] - depths[j];
    return {a.squaredNorm(), 2 * a.dot(b), b.squaredNorm(), dz * dz};
  }

  bool IsInFront(double shift) const {
    return std::all_of(depths.begin(), depths.end(), [shift](double depth) {
      return depth + shift > 0;
    });
  }

  Triangle Lift(double shift, double focal, double scale) const {
    Triangle triangle =
        LiftTriangle(points.data(),
                     {depths[0] + shift, depths[1] + shift, depths[2] + shift},
                     focal);
    for (Eigen::Vector3d& corner : triangle) corner *= scale;
    return triangle;
  }
};

// Adds a solution in the units of the views.
template <size_t N>
void AddSolution(const UnitView<N>& view1,
                 const UnitView<N>& view2,
                 double shift1,
                 double shift2,
                 double scale,
                 double focal1,
                 double focal2,
                 AffineDepthModels* models) {
  if (!view1.IsInFront(shift1) || !view2.IsInFront(shift2)) return;
  AffineDepthModel solution;
  TwoViewModel& model = solution.model;
  if (!AlignTriangles(view1.Lift(shift1, focal1, view1.depth_unit),
                      view2.Lift(shift2, focal2, scale * view1.depth_unit),
                      &model.rotation,
                      &model.translation)) {
    return;
  }
  model.scale = scale * view1.depth_unit / view2.depth_unit;
  model.focal1 = focal1 * view1.point_unit;
  model.focal2 = focal2 * view2.point_unit;
  solution.shift1 = shift1 * view1.depth_unit;
  solution.shift2 = shift2 * view2.depth_unit;
  if (model.IsFinite()) models->values[models->count++] = solution;
}

constexpr int kSides[5][2] = {{0, 1}, {0, 2}, {1, 2}, {0, 3}, {1, 3}};
constexpr int kNumPolishSteps = 2;

// a^2 - b c for quadratic polynomials with the leading coefficient first.
std::array<double, 5> SquareMinusProduct(const Eigen::RowVector3d& a,
                                         const Eigen::RowVector3d& b,
                                         const Eigen::RowVector3d& c) {
  return {
      a(0) * a(0) - b(0) * c(0),
      2 * a(0) * a(1) - b(0) * c(1) - b(1) * c(0),
      2 * a(0) * a(2) + a(1) * a(1) - b(0) * c(2) - b(1) * c(1) - b(2) * c(0),
      2 * a(1) * a(2) - b(1) * c(2) - b(2) * c(1),
      a(2) * a(2) - b(2) * c(2)};
}

// Newton on left (u^2, u, 1) = w right (v^2, v, 1).
void PolishShifts(const Eigen::Matrix3d& left,
                  const Eigen::Matrix3d& right,
                  Eigen::Vector3d* uvw) {
  for (int step = 0; step < kNumPolishSteps; ++step) {
    const double u = (*uvw)(0);
    const double v = (*uvw)(1);
    const double w = (*uvw)(2);
    const Eigen::Vector3d side2 = right * Eigen::Vector3d(v * v, v, 1);
    const Eigen::Vector3d residual =
        left * Eigen::Vector3d(u * u, u, 1) - w * side2;
    Eigen::Matrix3d jacobian;
    jacobian << 2 * u * left.col(0) + left.col(1),
        -w * (2 * v * right.col(0) + right.col(1)), -side2;
    const Eigen::Vector3d change = jacobian.inverse() * residual;
    // Near a double root the closed form is as good.
    if (!(change.norm() < 0.1 * uvw->norm())) return;
    *uvw -= change;
  }
}

// The plane of solutions z = origin + lambda directions[0] + mu directions[1]
// and a conic z_i z_k = z_j^2 in it,
//   mu2 mu^2 + (mu1[0] lambda + mu1[1]) mu + quadratic in lambda.
struct Conic {
  double mu2;
  std::array<double, 2> mu1;
  std::array<double, 3> mu0;

  Conic(const Eigen::Matrix<double, 7, 3>& plane, int i) {
    const auto entry = [&](int a, int b) {
      return plane(i, a) * plane(i + 2, b) - plane(i + 1, a) * plane(i + 1, b);
    };
    const auto mixed = [&](int a, int b) { return entry(a, b) + entry(b, a); };
    mu2 = entry(2, 2);
    mu1 = {mixed(1, 2), mixed(0, 2)};
    mu0 = {entry(1, 1), mixed(0, 1), entry(0, 0)};
  }

  // Value and derivatives by lambda and mu.
  Eigen::Vector3d At(double lambda, double mu) const {
    return {mu2 * mu * mu + (mu1[0] * lambda + mu1[1]) * mu +
                (mu0[0] * lambda + mu0[1]) * lambda + mu0[2],
            mu1[0] * mu + 2 * mu0[0] * lambda + mu0[1],
            2 * mu2 * mu + mu1[0] * lambda + mu1[1]};
  }
};

void PolishIntersection(const Conic& conic1,
                        const Conic& conic2,
                        double* lambda,
                        double* mu) {
  for (int step = 0; step < kNumPolishSteps; ++step) {
    const Eigen::Vector3d a = conic1.At(*lambda, *mu);
    const Eigen::Vector3d b = conic2.At(*lambda, *mu);
    const double determinant = a(1) * b(2) - a(2) * b(1);
    const double dlambda = (a(0) * b(2) - a(2) * b(0)) / determinant;
    const double dmu = (a(1) * b(0) - a(0) * b(1)) / determinant;
    if (!(std::hypot(dlambda, dmu) < 0.1 * std::hypot(*lambda, *mu))) return;
    *lambda -= dlambda;
    *mu -= dmu;
  }
}

// All z with the five linear equations: a point and two directions.
Eigen::Matrix<double, 7, 3> SolutionPlane(const UnitView<4>& view1,
                                          const UnitView<4>& view2) {
  Eigen::Matrix<double, 7, 5> system;  // one equation per column
  Eigen::Matrix<double, 5, 1> right;
  for (int k = 0; k < 5; ++k) {
    const Eigen::Vector4d c1 = view1.Coefficients(kSides[k][0], kSides[k][1]);
    const Eigen::Vector4d c2 = view2.Coefficients(kSides[k][0], kSides[k][1]);
    system.col(k) << c1.head<3>(), -c2;
    right(k) = -c1(3);
  }
  const Eigen::HouseholderQR<Eigen::Matrix<double, 7, 5>> qr(system);
  // Columns: the shortest solution in the frame of Q, the null space.
  Eigen::Matrix<double, 7, 3> plane = Eigen::Matrix<double, 7, 3>::Zero();
  plane.block<5, 1>(0, 0) = qr.matrixQR()
                                .topRows<5>()
                                .triangularView<Eigen::Upper>()
                                .transpose()
                                .solve(right);
  plane(5, 1) = plane(6, 2) = 1;
  plane.applyOnTheLeft(qr.householderQ());
  return plane;
}

// Real lambda of the intersections of two conics: with U, V, W from
// eliminating mu^2 and 1, U^2 = V W.
RealRoots IntersectConics(const Conic& c,
                          const Conic& d,
                          std::array<double, 3>* u,
                          std::array<double, 2>* v) {
  for (int k = 0; k < 3; ++k) (*u)[k] = c.mu2 * d.mu0[k] - d.mu2 * c.mu0[k];
  for (int k = 0; k < 2; ++k) (*v)[k] = c.mu2 * d.mu1[k] - d.mu2 * c.mu1[k];
  std::array<double, 4> w{};
  std::array<double, 5> quartic{};
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 3; ++k) {
      w[i + k] += c.mu1[i] * d.mu0[k] - d.mu1[i] * c.mu0[k];
    }
  }
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) quartic[i + k] += (*u)[i] * (*u)[k];
  }
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 4; ++k) quartic[i + k] -= (*v)[i] * w[k];
  }
  return SolveQuartic(quartic);
}

}  // namespace

AffineDepthModels SolveCalibratedAffine(const DepthTriplet& triplet) {
  UnitView<3> view1(triplet.points1, triplet.depths1);
  UnitView<3> view2(triplet.points2, triplet.depths2);
  // Known focal lengths, in the units of the points.
  const double phi = view1.point_unit * view1.point_unit;
  const double psi = view2.point_unit * view2.point_unit;
  Eigen::Matrix3d left, right;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector4d c1 = view1.Coefficients(kSides[k][0], kSides[k][1]);
    const Eigen::Vector4d c2 = view2.Coefficients(kSides[k][0], kSides[k][1]);
    left.row(k) = phi * c1.head<3>().transpose();
    right.row(k) = psi * c2.head<3>().transpose();
    left(k, 2) += c1(3);
    right(k, 2) += c2(3);
  }
  // w (v^2, v, 1) = ratio (u^2, u, 1).
  const Eigen::Matrix3d ratio = right.inverse() * left;
  const RealRoots roots = SolveQuartic(
      SquareMinusProduct(ratio.row(1), ratio.row(0), ratio.row(2)));
  AffineDepthModels models;
  for (int i = 0; i < roots.count; ++i) {
    const double u = roots.values[i];
    const Eigen::Vector3d powers(u * u, u, 1);
    const double w = ratio.row(2) * powers;
    if (!(w > 0)) continue;
    const double v = ratio.row(1).dot(powers) / w;
    Eigen::Vector3d uvw(u, v, w);
    PolishShifts(left, right, &uvw);
    if (!(uvw(2) > 0)) continue;
    AddSolution(view1,
                view2,
                uvw(0),
                uvw(1),
                std::sqrt(uvw(2)),
                1 / view1.point_unit,
                1 / view2.point_unit,
                &models);
  }
  return models;
}

AffineDepthModels SolveTwoFocalsAffine(const DepthQuadruple& quadruple) {
  const UnitView<4> view1(quadruple.points1, quadruple.depths1);
  const UnitView<4> view2(quadruple.points2, quadruple.depths2);
  const Eigen::Matrix<double, 7, 3> plane = SolutionPlane(view1, view2);
  const Conic conic1(plane, 0);
  const Conic conic2(plane, 3);
  std::array<double, 3> u;
  std::array<double, 2> v;
  const RealRoots roots = IntersectConics(conic1, conic2, &u, &v);
  AffineDepthModels models;
  for (int i = 0; i < roots.count; ++i) {
    double lambda = roots.values[i];
    double mu =
        -((u[0] * lambda + u[1]) * lambda + u[2]) / (v[0] * lambda + v[1]);
    PolishIntersection(conic1, conic2, &lambda, &mu);
    const Eigen::Matrix<double, 7, 1> z =
        plane * Eigen::Vector3d(1, lambda, mu);
    const double phi = z(2);
    const double psi = z(5) / z(6);
    if (!(phi > 0 && z(6) > 0 && psi > 0)) continue;
    AddSolution(view1,
                view2,
                z(1) / phi,
                z(4) / z(5),
                std::sqrt(z(6)),
                1 / std::sqrt(phi),
                1 / std::sqrt(psi),
                &models);
  }
  return models;
}

}  // namespace dgsfm
