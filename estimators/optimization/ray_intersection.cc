#include "estimators/optimization/ray_intersection.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace dgsfm {

namespace {

// Projector onto the plane orthogonal to a unit ray.
Eigen::Matrix3d OrthogonalProjector(const Eigen::Vector3d& ray) {
  return Eigen::Matrix3d::Identity() - ray * ray.transpose();
}

// Solves A x = b for a symmetric positive semi-definite A; nothing if A is
// nearly singular (smallest against largest eigenvalue).
std::optional<Eigen::Vector3d> SolveWellConditioned(const Eigen::Matrix3d& A,
                                                    const Eigen::Vector3d& b) {
  constexpr double kMinConditionRatio = 1e-8;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(A);
  const Eigen::Vector3d& values = eigen.eigenvalues();
  if (!(values(0) > kMinConditionRatio * values(2))) return std::nullopt;
  return eigen.eigenvectors() *
         (eigen.eigenvectors().transpose() * b).cwiseQuotient(values);
}

}  // namespace

double AngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / M_PI;
}

Eigen::Vector3d ComponentwiseMedian(
    const std::vector<Eigen::Vector3d>& points) {
  DGSFM_CHECK(!points.empty());
  Eigen::Vector3d median;
  std::vector<double> values(points.size());
  for (int k = 0; k < 3; ++k) {
    for (size_t i = 0; i < points.size(); ++i) values[i] = points[i](k);
    median(k) = Median(values);
  }
  return median;
}

std::optional<Eigen::Vector3d> TriangulateRays(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays,
    double min_angle_deg) {
  DGSFM_CHECK(centers.size() == rays.size());
  double max_angle_deg = 0;
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Matrix3d projector = OrthogonalProjector(rays[i]);
    A += projector;
    b += projector * centers[i];
    for (size_t j = 0; j < i; ++j) {
      max_angle_deg = std::max(max_angle_deg, AngleDeg(rays[i], rays[j]));
    }
  }
  if (rays.size() < 2 || max_angle_deg < min_angle_deg) return std::nullopt;
  const std::optional<Eigen::Vector3d> point = SolveWellConditioned(A, b);
  if (!point) return std::nullopt;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (rays[i].dot(*point - centers[i]) <= 0) return std::nullopt;
  }
  return point;
}

std::optional<Eigen::Vector3d> ResectCenter(
    const std::vector<Eigen::Vector3d>& points,
    const std::vector<Eigen::Vector3d>& rays) {
  DGSFM_CHECK(points.size() == rays.size());
  constexpr int kNumIterations = 20;
  // Angle below which a residual counts as fully trusted [rad].
  constexpr double kMinAngleRad = 1e-4;

  std::vector<double> weights(points.size(), 1);
  std::optional<Eigen::Vector3d> center;
  for (int iteration = 0; iteration < kNumIterations; ++iteration) {
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < points.size(); ++i) {
      const Eigen::Matrix3d projector =
          weights[i] * OrthogonalProjector(rays[i]);
      A += projector;
      b += projector * points[i];
    }
    center = SolveWellConditioned(A, b);
    if (!center) return std::nullopt;
    for (size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d direction = points[i] - *center;
      const double squared_distance = direction.squaredNorm();
      const double angle =
          std::atan2(rays[i].cross(direction).norm(), rays[i].dot(direction));
      // Distances across the ray count by their angle from the centre.
      weights[i] = 1 / (std::max(angle, kMinAngleRad) *
                        std::max(squared_distance, 1e-12));
    }
  }
  size_t num_in_front = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    num_in_front += rays[i].dot(points[i] - *center) > 0;
  }
  if (2 * num_in_front <= points.size()) return std::nullopt;
  return center;
}

}  // namespace dgsfm
