#include "estimators/optimization/ray_point_residual.h"

#include <cmath>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

Eigen::Vector3d RandomVector(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return {normal(*random), normal(*random), normal(*random)};
}

TEST(RayPointResidual, NormIsTheSineOfTheAngle) {
  for (const double angle : {0.0, 1e-6, 0.3, 1.0, 1.57}) {
    const Eigen::Vector3d direction(std::sin(angle), 0, std::cos(angle));
    const Eigen::Vector3d residual =
        RayPointResidual(Eigen::Vector3d::UnitZ(), 5 * direction, nullptr);
    // A difference of numbers around one.
    EXPECT_NEAR(residual.norm(), std::sin(angle), 1e-15);
    EXPECT_NEAR(residual.dot(direction), 0, 1e-15);
  }
}

TEST(RayPointResidual, IsTheBataResidualAtItsBestScale) {
  std::mt19937 random(1);
  const Eigen::Vector3d ray = RandomVector(&random).normalized();
  const Eigen::Vector3d v = ray + 0.3 * RandomVector(&random);
  const double best = ray.dot(v) / v.squaredNorm();
  const Eigen::Vector3d residual = RayPointResidual(ray, v, nullptr);
  EXPECT_LT((residual - (ray - best * v)).norm(), 1e-15);
  for (const double scale : {0.9 * best, 1.1 * best}) {
    EXPECT_GT((ray - scale * v).norm(), residual.norm());
  }
}

TEST(RayPointResidual, BehindAndAtTheCameraThereIsNoGradient) {
  const Eigen::Vector3d ray = Eigen::Vector3d::UnitZ();
  for (const Eigen::Vector3d& v : {Eigen::Vector3d(0.1, 0, -1),
                                   Eigen::Vector3d(1, 0, 0),
                                   Eigen::Vector3d(0, 0, 0)}) {
    Eigen::Matrix3d by_point;
    EXPECT_EQ(RayPointResidual(ray, v, &by_point), ray);
    EXPECT_TRUE(by_point.isZero(0));
  }
}

TEST(RayPointResidual, JacobiansAgreeWithCentralDifferences) {
  std::mt19937 random(2);
  // Deviations from the ray up to a right angle, distances near and far.
  for (const double deviation : {0.0, 1e-3, 0.3, 1.5}) {
    for (const double distance : {1e-3, 1.0, 1e3}) {
      const Eigen::Vector3d ray = RandomVector(&random).normalized();
      const Eigen::Vector3d side =
          ray.cross(RandomVector(&random)).normalized();
      const Eigen::Vector3d v =
          distance * (std::cos(deviation) * ray + std::sin(deviation) * side);
      Eigen::Matrix3d by_point;
      RayPointResidual(ray, v, &by_point);
      const double step = 1e-5 * distance;
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d delta = step * Eigen::Vector3d::Unit(i);
        const Eigen::Vector3d difference =
            (RayPointResidual(ray, v + delta, nullptr) -
             RayPointResidual(ray, v - delta, nullptr)) /
            (2 * step);
        // Third derivatives give 1e-10, relative to derivatives of
        // 1 / distance.
        EXPECT_LT((difference - by_point.col(i)).norm() * distance, 1e-9);
      }
    }
  }
}

}  // namespace
}  // namespace dgsfm
