#include "estimators/optimization/ray_intersection.h"

#include "estimators/median.h"

#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Exact linear problems of well-separated rays: rounding only.
constexpr double kExact = 1e-10;

Eigen::Vector3d RandomVector(std::mt19937_64* random, double size) {
  std::uniform_real_distribution<double> uniform(-size, size);
  return {uniform(*random), uniform(*random), uniform(*random)};
}

TEST(Median, OddAndEvenCounts) {
  EXPECT_EQ(Median({3, 1, 2}), 2);
  EXPECT_EQ(Median({4, 1, 3, 2}), 2.5);
  EXPECT_EQ(Median({7}), 7);
  EXPECT_THROW(Median({}), std::invalid_argument);
}

TEST(ComponentwiseMedian, OutlierDoesNotMoveIt) {
  const Eigen::Vector3d median =
      ComponentwiseMedian({{1, 10, 3}, {2, 20, 2}, {1e9, -1e9, 1}});
  EXPECT_EQ(median, Eigen::Vector3d(2, 10, 2));
}

TEST(TriangulateRays, RecoversPointOfExactRays) {
  std::mt19937_64 random(0);
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Vector3d point = RandomVector(&random, 1);
    std::vector<Eigen::Vector3d> centers;
    std::vector<Eigen::Vector3d> rays;
    for (int i = 0; i < 4; ++i) {
      centers.push_back(RandomVector(&random, 5) + Eigen::Vector3d(0, 0, 10));
      rays.push_back((point - centers.back()).normalized());
    }
    const auto triangulated = TriangulateRays(centers, rays, 0.1);
    ASSERT_TRUE(triangulated);
    // Depths of 10 and angles of some degrees amplify rounding.
    EXPECT_LT((*triangulated - point).norm(), 1e-9);
  }
}

TEST(TriangulateRays, RefusesSmallAnglesAndPointsBehind) {
  const Eigen::Vector3d z(0, 0, 1);
  EXPECT_FALSE(TriangulateRays({{0, 0, 0}}, {z}, 0.1));
  EXPECT_FALSE(TriangulateRays({{0, 0, 0}, {1, 0, 0}}, {z, z}, 0.1));
  // Diverging rays meet behind the centres.
  EXPECT_FALSE(TriangulateRays({{0, 0, 0}, {1, 0, 0}},
                               {Eigen::Vector3d(-1, 0, 1).normalized(),
                                Eigen::Vector3d(1, 0, 1).normalized()},
                               0.1));
}

TEST(ResectCenter, RecoversCenterUnderThirtyPercentOutliers) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3d center = RandomVector(&random, 1);
    std::vector<Eigen::Vector3d> points;
    std::vector<Eigen::Vector3d> rays;
    for (int i = 0; i < 100; ++i) {
      points.push_back(RandomVector(&random, 4) + Eigen::Vector3d(0, 0, 10));
      rays.push_back((points.back() - center).normalized());
      if (i % 10 < 3) {
        rays.back() = (rays.back() + RandomVector(&random, 0.5)).normalized();
      }
    }
    const auto resected = ResectCenter(points, rays);
    ASSERT_TRUE(resected);
    // The cost is quadratic below 1e-4 rad, so the outliers' pull leaves about
    // that angle times the distance of ten; ten times that is far below what
    // any of them would do to a least-squares fit.
    EXPECT_LT((*resected - center).norm(), 1e-2);
  }
}

TEST(ResectCenter, ExactRaysAreExact) {
  const Eigen::Vector3d center(0.5, -0.25, 1);
  const std::vector<Eigen::Vector3d> points = {
      {0, 0, 5}, {1, 2, 6}, {-2, 1, 7}, {1, -1, 4}};
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector3d& point : points) {
    rays.push_back((point - center).normalized());
  }
  const auto resected = ResectCenter(points, rays);
  ASSERT_TRUE(resected);
  EXPECT_LT((*resected - center).norm(), kExact);
}

TEST(ResectCenter, RefusesParallelRaysAndPointsBehind) {
  const Eigen::Vector3d z(0, 0, 1);
  EXPECT_FALSE(ResectCenter({{0, 0, 5}, {1, 0, 5}, {0, 1, 5}}, {z, z, z}));
  const Eigen::Vector3d center(0, 0, 0);
  std::vector<Eigen::Vector3d> points = {{0, 0, 5}, {1, 2, 6}, {-2, 1, 7}};
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector3d& point : points)
    rays.push_back(-point.normalized());
  EXPECT_FALSE(ResectCenter(points, rays));
}

}  // namespace
}  // namespace dgsfm
