#include "estimators/solvers/relative_pose_affine_depth.h"

#include "tests/estimators/depth_problems.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kNumProblems = 10000;

template <typename Solve>
void ExpectSolved(bool calibrated, double min_share, const Solve& solve) {
  std::mt19937_64 random(1);
  std::vector<double> distances;
  int num_found = 0;
  for (int k = 0; k < kNumProblems; ++k) {
    const AffineDepthProblem problem = CreateAffineProblem(calibrated, &random);
    distances.push_back(BestDistance(solve(problem), problem.truth));
    num_found += distances.back() < 1e-6;
  }
  EXPECT_GE(num_found, min_share * kNumProblems);
  std::nth_element(
      distances.begin(), distances.begin() + kNumProblems / 2, distances.end());
  // Rounding through a quartic, amplified by the shifts.
  EXPECT_LT(distances[kNumProblems / 2], 1e-12);
}

TEST(RelativePoseAffineDepth, FindsTruthOfCalibratedProblems) {
  ExpectSolved(true, 0.999, [](const AffineDepthProblem& problem) {
    return SolveCalibratedAffine(problem.Triplet());
  });
}

TEST(RelativePoseAffineDepth, FindsTruthOfTwoFocalProblems) {
  ExpectSolved(false, 0.99, [](const AffineDepthProblem& problem) {
    return SolveTwoFocalsAffine(problem.quadruple);
  });
}

TEST(RelativePoseAffineDepth, DegenerateProblemsGiveFiniteSolutionsOrNone) {
  std::mt19937_64 random(2);
  for (int k = 0; k < 200; ++k) {
    std::vector<AffineDepthProblem> problems(
        5, CreateAffineProblem(false, &random));
    DepthQuadruple* quadruple = &problems[0].quadruple;  // equal depths
    quadruple->depths1 = quadruple->depths2 = {1, 1, 1, 1};
    quadruple = &problems[1].quadruple;  // no motion
    quadruple->points2 = quadruple->points1;
    quadruple->depths2 = quadruple->depths1;
    quadruple = &problems[2].quadruple;  // one point twice
    quadruple->points1[1] = quadruple->points1[0];
    quadruple->points2[1] = quadruple->points2[0];
    quadruple->depths1[1] = quadruple->depths1[0];
    quadruple->depths2[1] = quadruple->depths2[0];
    quadruple = &problems[3].quadruple;  // all points at the centre
    for (Eigen::Vector2d& point : quadruple->points1) point.setZero();
    quadruple = &problems[4].quadruple;
    quadruple->depths1[2] = std::numeric_limits<double>::quiet_NaN();
    for (const AffineDepthProblem& problem : problems) {
      for (const AffineDepthModels& models :
           {SolveCalibratedAffine(problem.Triplet()),
            SolveTwoFocalsAffine(problem.quadruple)}) {
        for (int i = 0; i < models.count; ++i) {
          EXPECT_TRUE(models.values[i].model.IsFinite());
          EXPECT_TRUE(std::isfinite(models.values[i].shift1));
          EXPECT_TRUE(std::isfinite(models.values[i].shift2));
        }
      }
    }
  }
}

}  // namespace
}  // namespace dgsfm
