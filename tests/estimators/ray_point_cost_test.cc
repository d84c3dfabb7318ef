#include "estimators/ray_point_cost.h"

#include <cmath>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using RowMatrix3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

struct Evaluation {
  Eigen::Vector3d residual;
  RowMatrix3d J_residual_center;
  RowMatrix3d J_residual_point;
};

Eigen::Vector3d Residual(const Eigen::Vector3d& ray,
                         const Eigen::Vector3d& center,
                         const Eigen::Vector3d& point) {
  const double* parameters[] = {center.data(), point.data()};
  Eigen::Vector3d residual;
  EXPECT_TRUE(
      RayPointCostFunction(ray).Evaluate(parameters, residual.data(), nullptr));
  return residual;
}

Evaluation Evaluate(const Eigen::Vector3d& ray,
                    const Eigen::Vector3d& center,
                    const Eigen::Vector3d& point) {
  const double* parameters[] = {center.data(), point.data()};
  Evaluation result;
  double* jacobians[] = {result.J_residual_center.data(),
                         result.J_residual_point.data()};
  EXPECT_TRUE(RayPointCostFunction(ray).Evaluate(
      parameters, result.residual.data(), jacobians));
  EXPECT_EQ(result.residual, Residual(ray, center, point));
  return result;
}

Eigen::Vector3d RandomVector(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return {normal(*random), normal(*random), normal(*random)};
}

TEST(RayPointCost, NormIsTheSineOfTheAngle) {
  const Eigen::Vector3d center(1, 2, 3);
  for (const double angle : {0.0, 1e-6, 0.3, 1.0, 1.57}) {
    const Eigen::Vector3d direction(std::sin(angle), 0, std::cos(angle));
    const Eigen::Vector3d residual =
        Residual(Eigen::Vector3d::UnitZ(), center, center + 5 * direction);
    // A difference of numbers around one.
    EXPECT_NEAR(residual.norm(), std::sin(angle), 1e-15);
    EXPECT_NEAR(residual.dot(direction), 0, 1e-15);
  }
}

TEST(RayPointCost, IsTheBataResidualAtItsBestScale) {
  std::mt19937 random(1);
  const Eigen::Vector3d ray = RandomVector(&random).normalized();
  const Eigen::Vector3d center = RandomVector(&random);
  const Eigen::Vector3d point = center + ray + 0.3 * RandomVector(&random);
  const Eigen::Vector3d v = point - center;
  const double best = ray.dot(v) / v.squaredNorm();
  const Eigen::Vector3d residual = Residual(ray, center, point);
  EXPECT_LT((residual - (ray - best * v)).norm(), 1e-15);
  for (const double scale : {0.9 * best, 1.1 * best}) {
    EXPECT_GT((ray - scale * v).norm(), residual.norm());
  }
}

TEST(RayPointCost, BehindAndAtTheCameraThereIsNoGradient) {
  const Eigen::Vector3d ray = Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d center(1, 2, 3);
  for (const Eigen::Vector3d& v : {Eigen::Vector3d(0.1, 0, -1),
                                   Eigen::Vector3d(1, 0, 0),
                                   Eigen::Vector3d(0, 0, 0)}) {
    const Evaluation result = Evaluate(ray, center, center + v);
    EXPECT_EQ(result.residual, ray);
    EXPECT_TRUE(result.J_residual_center.isZero(0));
    EXPECT_TRUE(result.J_residual_point.isZero(0));
  }
}

TEST(RayPointCost, JacobiansAgreeWithCentralDifferences) {
  std::mt19937 random(2);
  // Deviations from the ray up to a right angle, distances near and far.
  for (const double deviation : {0.0, 1e-3, 0.3, 1.5}) {
    for (const double distance : {1e-3, 1.0, 1e3}) {
      const Eigen::Vector3d ray = RandomVector(&random).normalized();
      const Eigen::Vector3d side =
          ray.cross(RandomVector(&random)).normalized();
      const Eigen::Vector3d center = RandomVector(&random);
      const Eigen::Vector3d point =
          center +
          distance * (std::cos(deviation) * ray + std::sin(deviation) * side);
      const Evaluation result = Evaluate(ray, center, point);
      const double step = 1e-5 * distance;
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d delta = step * Eigen::Vector3d::Unit(i);
        const Eigen::Vector3d J_point = (Residual(ray, center, point + delta) -
                                         Residual(ray, center, point - delta)) /
                                        (2 * step);
        const Eigen::Vector3d J_center =
            (Residual(ray, center + delta, point) -
             Residual(ray, center - delta, point)) /
            (2 * step);
        // Third derivatives give 1e-10, and rounding of coordinates around
        // one over a step of 1e-8 at the shortest distance 1e-8, relative to
        // Jacobians of 1 / distance.
        EXPECT_LT((J_point - result.J_residual_point.col(i)).norm() * distance,
                  1e-6);
        EXPECT_LT(
            (J_center - result.J_residual_center.col(i)).norm() * distance,
            1e-6);
      }
    }
  }
}

}  // namespace
}  // namespace dgsfm
