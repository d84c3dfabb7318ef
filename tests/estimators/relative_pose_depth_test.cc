#include "estimators/solvers/relative_pose_depth.h"

#include "tests/estimators/depth_problems.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kNumProblems = 10000;

struct SolverCase {
  const char* name;
  Focals focals;
  std::function<TwoViewModels(const DepthTriplet&)> solve;
  int max_num_solutions;
};

class RelativePoseDepth : public testing::TestWithParam<SolverCase> {};

TEST_P(RelativePoseDepth, FindsTruthOfExactProblems) {
  std::mt19937_64 random(1);
  std::vector<double> distances;
  int num_found = 0;
  for (int k = 0; k < kNumProblems; ++k) {
    const DepthProblem problem = CreateDepthProblem(GetParam().focals, &random);
    const TwoViewModels models = GetParam().solve(problem.triplet);
    ASSERT_LE(models.count, GetParam().max_num_solutions);
    distances.push_back(BestDistance(models, problem.truth));
    num_found += distances.back() < 1e-6;
  }
  EXPECT_GE(num_found, 0.999 * kNumProblems);
  std::nth_element(
      distances.begin(), distances.begin() + kNumProblems / 2, distances.end());
  EXPECT_LT(distances[kNumProblems / 2], 1e-12);
}

// Every solution moves the triangle of view 1 onto points on the rays of view
// 2, has a proper rotation, and its scale fits the depths.
TEST_P(RelativePoseDepth, SolutionsSatisfyTheEquations) {
  std::mt19937_64 random(2);
  int num_checked = 0;
  for (int k = 0; k < 1000; ++k) {
    const DepthTriplet triplet =
        CreateDepthProblem(GetParam().focals, &random).triplet;
    const TwoViewModels models = GetParam().solve(triplet);
    for (int i = 0; i < models.count; ++i) {
      const TwoViewModel& model = models.values[i];
      ASSERT_TRUE(model.IsFinite());
      // Products of orthonormal frames: rounding only.
      EXPECT_NEAR(model.rotation.determinant(), 1, 1e-12);
      EXPECT_LT((model.rotation * model.rotation.transpose() -
                 Eigen::Matrix3d::Identity())
                    .norm(),
                1e-12);
      double worst = 0;
      for (int j = 0; j < 3; ++j) {
        Eigen::Vector3d point1;
        point1 << triplet.points1[j] / model.focal1, 1;
        const Eigen::Vector3d point2 =
            model.rotation * (triplet.depths1[j] * point1) + model.translation;
        EXPECT_GT(point2.z(), 0);
        const Eigen::Vector2d error =
            model.focal2 * point2.head<2>() / point2.z() - triplet.points2[j];
        worst = std::max(worst, error.norm());
      }
      // Far worse conditioned than the truth: spurious roots may be extreme.
      num_checked += worst < 1e-8;
      EXPECT_LT(worst, 1e-3);
    }
  }
  EXPECT_GE(num_checked, 990);
}

TEST_P(RelativePoseDepth, DoesNotDependOnUnits) {
  std::mt19937_64 random(3);
  for (int k = 0; k < 200; ++k) {
    const DepthProblem problem = CreateDepthProblem(GetParam().focals, &random);
    // Well-conditioned ones: others may differ in their last digits.
    if (BestDistance(GetParam().solve(problem.triplet), problem.truth) >
        1e-11) {
      continue;
    }
    DepthTriplet triplet = problem.triplet;
    TwoViewModel expected = problem.truth;
    for (double& depth : triplet.depths1) depth *= 1e3;
    for (double& depth : triplet.depths2) depth *= 1e-3;
    expected.translation *= 1e3;
    expected.scale *= 1e6;
    if (GetParam().focals == Focals::SHARED ||
        GetParam().focals == Focals::TWO) {
      for (Eigen::Vector2d& point : triplet.points1) point *= 1e3;
      for (Eigen::Vector2d& point : triplet.points2) point *= 1e3;
      expected.focal1 *= 1e3;
      expected.focal2 *= 1e3;
    }
    EXPECT_LT(BestDistance(GetParam().solve(triplet), expected), 1e-8);
  }
}

TEST_P(RelativePoseDepth, SwappedViewsGiveTheInverse) {
  // There the known focal length would change sides.
  if (GetParam().focals == Focals::ONE_SIDED) return;
  std::mt19937_64 random(4);
  int num_found = 0;
  for (int k = 0; k < 1000; ++k) {
    const DepthProblem problem = CreateDepthProblem(GetParam().focals, &random);
    num_found += BestDistance(GetParam().solve(problem.triplet.Swapped()),
                              problem.truth.Inverse()) < 1e-6;
  }
  EXPECT_GE(num_found, 999);
}

TEST_P(RelativePoseDepth, DegenerateProblemsGiveFiniteSolutionsOrNone) {
  std::mt19937_64 random(5);
  const auto expect_finite = [&](const DepthTriplet& triplet) {
    const TwoViewModels models = GetParam().solve(triplet);
    for (int i = 0; i < models.count; ++i) {
      EXPECT_TRUE(models.values[i].IsFinite());
    }
  };
  for (int k = 0; k < 200; ++k) {
    const DepthTriplet good =
        CreateDepthProblem(GetParam().focals, &random).triplet;
    DepthTriplet triplet = good;  // one point twice
    triplet.points1[1] = triplet.points1[0];
    triplet.points2[1] = triplet.points2[0];
    triplet.depths1[1] = triplet.depths1[0];
    triplet.depths2[1] = triplet.depths2[0];
    expect_finite(triplet);
    triplet = good;  // no motion
    triplet.points2 = triplet.points1;
    triplet.depths2 = triplet.depths1;
    expect_finite(triplet);
    triplet = good;  // equal depths
    triplet.depths1 = triplet.depths2 = {1, 1, 1};
    expect_finite(triplet);
    triplet = good;  // on a line
    for (int i = 0; i < 3; ++i) {
      triplet.points1[i] = triplet.points2[i] = Eigen::Vector2d(i, i);
      triplet.depths1[i] = triplet.depths2[i] = 1;
    }
    expect_finite(triplet);
    triplet = good;
    for (int i = 0; i < 3; ++i) triplet.points1[i].setZero();
    expect_finite(triplet);
    triplet = good;
    triplet.depths1[2] = std::numeric_limits<double>::quiet_NaN();
    expect_finite(triplet);
  }
}

std::string CaseName(const testing::TestParamInfo<SolverCase>& info) {
  return info.param.name;
}

INSTANTIATE_TEST_SUITE_P(
    Solvers,
    RelativePoseDepth,
    testing::Values(
        SolverCase{"P3PScale", Focals::KNOWN, SolveP3PScale, 4},
        SolverCase{"SharedFocal", Focals::SHARED, SolveSharedFocal, 4},
        SolverCase{"TwoFocals", Focals::TWO, SolveTwoFocals, 1},
        SolverCase{"OneSidedFocal", Focals::ONE_SIDED, SolveOneSidedFocal, 1}),
    CaseName);

}  // namespace
}  // namespace dgsfm
