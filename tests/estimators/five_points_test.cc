#include "estimators/solvers/five_points.h"

#include "estimators/two_view/two_view_model.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(FivePoints, FindsTruthOfExactProblems) {
  constexpr int kNumProblems = 10000;
  std::mt19937_64 random(1);
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(random);
  };
  std::vector<double> distances;
  int num_found = 0;
  for (int problem = 0; problem < kNumProblems; ++problem) {
    TwoViewModel truth;
    const Eigen::Vector3d axis(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    truth.rotation =
        Eigen::AngleAxisd(uniform(0, 1), axis.normalized()).toRotationMatrix();
    truth.translation << uniform(-2, 2), uniform(-2, 2), uniform(-2, 2);
    std::array<Eigen::Vector2d, 5> points1, points2;
    for (int i = 0; i < 5; ++i) {
      const double z = uniform(3, 10);
      const Eigen::Vector3d point1(z * uniform(-1, 1), z * uniform(-1, 1), z);
      points1[i] = point1.hnormalized();
      points2[i] = (truth.rotation * point1 + truth.translation).hnormalized();
    }
    const Eigen::Matrix3d E = truth.EssentialMatrix().normalized();
    const EssentialMatrices solutions = SolveFivePoints(points1, points2);
    ASSERT_LE(solutions.count, 10);
    double best = 1;
    for (int i = 0; i < solutions.count; ++i) {
      const Eigen::Matrix3d solution = solutions.values[i].normalized();
      best = std::min({best, (solution - E).norm(), (solution + E).norm()});
    }
    distances.push_back(best);
    num_found += best < 1e-6;
  }
  // Points behind camera 2 and solutions with |z| > 100 included.
  EXPECT_GE(num_found, 0.97 * kNumProblems);
  std::nth_element(
      distances.begin(), distances.begin() + kNumProblems / 2, distances.end());
  // Rounding, amplified by an elimination of size 10.
  EXPECT_LT(distances[kNumProblems / 2], 1e-11);
}

TEST(FivePoints, DegenerateProblemsGiveFiniteSolutionsOrNone) {
  std::array<Eigen::Vector2d, 5> line, point;
  for (int i = 0; i < 5; ++i) {
    line[i] << i, 2 * i;
    point[i].setZero();
  }
  for (const auto& points : {line, point}) {
    const EssentialMatrices solutions = SolveFivePoints(points, points);
    for (int i = 0; i < solutions.count; ++i) {
      EXPECT_TRUE(solutions.values[i].allFinite());
    }
  }
}

}  // namespace
}  // namespace dgsfm
