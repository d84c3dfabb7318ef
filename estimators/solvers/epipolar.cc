#include "estimators/solvers/epipolar.h"

#include "estimators/solvers/polynomial_lanes.h"

#include <cmath>

#include <Eigen/SVD>

namespace dgsfm {
namespace {

DGSFM_INLINE Lanes Determinant(const Lanes* a, const Lanes* b, const Lanes* c) {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) +
         a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

// d/dmu det(A + mu B) at 0, by columns.
DGSFM_INLINE Lanes DeterminantSlope(const MatrixLanes& A,
                                    const MatrixLanes& B) {
  const Lanes* a = A.entries;
  const Lanes* b = B.entries;
  return Determinant(b, a + 3, a + 6) + Determinant(a, b + 3, a + 6) +
         Determinant(a, a + 3, b + 6);
}

// The matrix of a lane with unit norm, if it is finite.
void AddSolution(const MatrixLanes& matrices,
                 int lane,
                 FundamentalMatrices* solutions) {
  Eigen::Matrix3d F;
  for (int entry = 0; entry < 9; ++entry) {
    F.data()[entry] = matrices.entries[entry][lane];
  }
  const double norm = F.norm();
  if (!(norm > 0 && std::isfinite(norm))) return;
  solutions->values[solutions->count++] = F / norm;
}

}  // namespace

DGSFM_TARGET_CLONES
std::array<FundamentalMatrices, kNumLanes> SolveSevenPoints(
    const SampleLanes<7>& samples) {
  const auto [A, B] = EpipolarNullSpace(samples);
  const Lanes* a = A.entries;
  const Lanes* b = B.entries;
  // det(A + mu B)
  const LanePolynomial<4> determinant = {{Determinant(a, a + 3, a + 6),
                                          DeterminantSlope(A, B),
                                          DeterminantSlope(B, A),
                                          Determinant(b, b + 3, b + 6)}};
  const LaneRoots<4> roots = FindRealRoots(determinant);
  std::array<FundamentalMatrices, kNumLanes> solutions;
  for (int i = 0; i < roots.count; ++i) {
    MatrixLanes matrices;
    for (int entry = 0; entry < 9; ++entry) {
      matrices.entries[entry] = a[entry] + roots.values[i] * b[entry];
    }
    for (int lane = 0; lane < kNumLanes; ++lane) {
      AddSolution(matrices, lane, &solutions[lane]);
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
