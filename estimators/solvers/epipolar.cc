#include "estimators/solvers/epipolar.h"

#include "estimators/solvers/polynomial.h"

#include <cmath>

#include <Eigen/QR>
#include <Eigen/SVD>

namespace dgsfm {
namespace {

// d/dmu det(A + mu B) at 0, i.e. the trace of adj(A) B.
double DeterminantSlope(const Eigen::Matrix3d& A, const Eigen::Matrix3d& B) {
  return B.col(0).dot(A.col(1).cross(A.col(2))) +
         B.col(1).dot(A.col(2).cross(A.col(0))) +
         B.col(2).dot(A.col(0).cross(A.col(1)));
}

}  // namespace

FundamentalMatrices SolveSevenPoints(
    const std::array<Eigen::Vector2d, 7>& points1,
    const std::array<Eigen::Vector2d, 7>& points2) {
  Eigen::Matrix<double, 9, 7> system;
  for (int i = 0; i < 7; ++i) {
    // Column-major vec(F): q p^T for each match.
    const Eigen::Vector3d p = points1[i].homogeneous();
    const Eigen::Vector3d q = points2[i].homogeneous();
    Eigen::Map<Eigen::Matrix3d>(system.col(i).data()) = q * p.transpose();
  }
  // The last columns of Q are orthogonal to the rows of the linear system.
  Eigen::Matrix<double, 9, 2> basis = Eigen::Matrix<double, 9, 2>::Zero();
  basis.bottomRows<2>().setIdentity();
  basis.applyOnTheLeft(
      Eigen::HouseholderQR<Eigen::Matrix<double, 9, 7>>(system).householderQ());
  const Eigen::Matrix3d A =
      Eigen::Map<const Eigen::Matrix3d>(basis.col(0).data());
  const Eigen::Matrix3d B =
      Eigen::Map<const Eigen::Matrix3d>(basis.col(1).data());
  const auto roots = FindRealRoots(Polynomial<4>{A.determinant(),
                                                 DeterminantSlope(A, B),
                                                 DeterminantSlope(B, A),
                                                 B.determinant()});
  FundamentalMatrices solutions;
  for (int i = 0; i < roots.count; ++i) {
    const Eigen::Matrix3d F = A + roots.values[i] * B;
    const double norm = F.norm();
    if (norm > 0 && std::isfinite(norm)) {
      solutions.values[solutions.count++] = F / norm;
    }
  }
  return solutions;
}

EssentialPoses DecomposeEssentialMatrix(const Eigen::Matrix3d& E) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
      E, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d U = svd.matrixU();
  Eigen::Matrix3d V = svd.matrixV();
  if (U.determinant() < 0) U = -U;
  if (V.determinant() < 0) V = -V;
  Eigen::Matrix3d quarter_turn;
  quarter_turn << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  return {{U * quarter_turn * V.transpose(),
           U * quarter_turn.transpose() * V.transpose()},
          U.col(2)};
}

double EssentialMatrixDefect(const Eigen::Matrix3d& F,
                             double focal1,
                             double focal2) {
  const Eigen::Matrix3d E = Eigen::Vector3d(focal2, focal2, 1).asDiagonal() *
                            F * Eigen::Vector3d(focal1, focal1, 1).asDiagonal();
  // With s3 = 0 the squared norms of E and of its cofactors are s1^2 + s2^2
  // and s1^2 s2^2.
  const double sum = E.squaredNorm();
  const double product = E.col(0).cross(E.col(1)).squaredNorm() +
                         E.col(1).cross(E.col(2)).squaredNorm() +
                         E.col(2).cross(E.col(0)).squaredNorm();
  return 1 - 4 * product / (sum * sum);
}

std::optional<RayIntersection> IntersectRays(const TwoViewModel& model,
                                             const Eigen::Vector2d& x1,
                                             const Eigen::Vector2d& x2) {
  const Eigen::Vector3d p =
      model.rotation *
      Eigen::Vector3d(x1.x() / model.focal1, x1.y() / model.focal1, 1);
  const Eigen::Vector3d q(x2.x() / model.focal2, x2.y() / model.focal2, 1);
  const double pp = p.squaredNorm();
  const double qq = q.squaredNorm();
  const double pq = p.dot(q);
  const double pt = p.dot(model.translation);
  const double qt = q.dot(model.translation);
  const Eigen::Vector3d normal = p.cross(q);
  const double determinant = normal.squaredNorm();
  if (!(determinant > 0)) return std::nullopt;
  RayIntersection intersection;
  intersection.depth1 = (pq * qt - qq * pt) / determinant;
  intersection.depth2 = (pp * qt - pq * pt) / determinant;
  intersection.angle_rad = std::atan2(normal.norm(), pq);
  if (!(intersection.depth1 > 0 && intersection.depth2 > 0)) {
    return std::nullopt;
  }
  return intersection;
}

}  // namespace dgsfm
