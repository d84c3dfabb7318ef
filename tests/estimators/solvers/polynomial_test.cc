#include "estimators/solvers/polynomial.h"

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Coefficients, highest power first, of the monic polynomial with these roots.
std::vector<double> FromRoots(const std::vector<double>& roots) {
  std::vector<double> c = {1};
  for (const double root : roots) {
    c.push_back(0);
    for (size_t i = c.size() - 1; i > 0; --i) c[i] -= root * c[i - 1];
  }
  return c;
}

template <typename Roots>
std::vector<double> Sorted(const Roots& roots) {
  std::vector<double> sorted(roots.values.begin(),
                             roots.values.begin() + roots.count);
  std::sort(sorted.begin(), sorted.end());
  return sorted;
}

void ExpectNear(const std::vector<double>& roots,
                const std::vector<double>& expected,
                double tolerance) {
  ASSERT_EQ(roots.size(), expected.size());
  for (size_t i = 0; i < roots.size(); ++i) {
    EXPECT_NEAR(roots[i], expected[i], tolerance);
  }
}

TEST(ClosedForm, FindsTheRootsOfRandomPolynomials) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-3, 3);
  for (int trial = 0; trial < 1000; ++trial) {
    std::vector<double> roots(4);
    for (double& root : roots) root = uniform(random);
    std::sort(roots.begin(), roots.end());
    double gap = 1;
    for (int i = 1; i < 4; ++i) gap = std::min(gap, roots[i] - roots[i - 1]);
    // Roots that are closer are nearly double ones.
    if (gap < 0.05) continue;
    const std::vector<double> c = FromRoots(roots);
    // Rounding of the coefficients, times up to 1 / gap^3.
    ExpectNear(
        Sorted(SolveQuartic({c[0], c[1], c[2], c[3], c[4]})), roots, 1e-8);
    const std::vector<double> c3 = FromRoots({roots[0], roots[1], roots[2]});
    ExpectNear(Sorted(SolveCubic({c3[0], c3[1], c3[2], c3[3]})),
               {roots[0], roots[1], roots[2]},
               1e-9);
    const std::vector<double> c2 = FromRoots({roots[0], roots[1]});
    ExpectNear(Sorted(SolveQuadratic({c2[0], c2[1], c2[2]})),
               {roots[0], roots[1]},
               1e-10);
  }
}

TEST(ClosedForm, LeavesOutComplexRoots) {
  EXPECT_EQ(SolveQuadratic({1, 0, 1}).count, 0);
  // (x - 2) (x^2 + 1)
  ExpectNear(Sorted(SolveCubic({1, -2, 1, -2})), {2}, 1e-12);
  // (x^2 + 1) (x^2 + 4)
  EXPECT_EQ(SolveQuartic({1, 0, 5, 0, 4}).count, 0);
}

TEST(ClosedForm, NegligibleLeadingCoefficientsLowerTheDegree) {
  ExpectNear(Sorted(SolveQuadratic({0, 2, -4})), {2}, 1e-15);
  ExpectNear(Sorted(SolveCubic({0, 1, -3, 2})), {1, 2}, 1e-12);
  ExpectNear(Sorted(SolveQuartic({1e-30, 0, 1, -3, 2})), {1, 2}, 1e-12);
}

TEST(ClosedForm, NothingOfWhatIsNoPolynomial) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(SolveQuadratic({0, 0, 0}).count, 0);
  EXPECT_EQ(SolveCubic({1, kNan, 0, 0}).count, 0);
  EXPECT_EQ(SolveQuartic({kNan, 0, 0, 0, 1}).count, 0);
}

std::array<double, 11> ConstantFirst(std::vector<double> highest_first) {
  std::array<double, 11> c = {};
  std::reverse(highest_first.begin(), highest_first.end());
  std::copy(highest_first.begin(), highest_first.end(), c.begin());
  return c;
}

TEST(FindRealRoots, FindsTenRootsInOrder) {
  const std::vector<double> roots = {
      -1.9, -1.4, -1, -0.5, -0.1, 0.3, 0.6, 1.1, 1.5, 1.8};
  // Ten roots in an interval of four: coefficients are up to 10, rounding is
  // amplified by about 1e4.
  ExpectNear(
      Sorted(FindRealRoots(ConstantFirst(FromRoots(roots)), 2)), roots, 1e-10);
}

TEST(FindRealRoots, KeepsToTheInterval) {
  const auto c =
      ConstantFirst(FromRoots({-4, -3.5, -3, -2.5, 0.6, 1.1, 2.5, 3, 3.5, 4}));
  // Products of up to nine differences amplify rounding by about 1e5.
  ExpectNear(Sorted(FindRealRoots(c, 2)), {0.6, 1.1}, 1e-9);
  EXPECT_EQ(FindRealRoots(c, 5.1).count, 10);
}

TEST(FindRealRoots, FindsNoneOfPositivePolynomials) {
  // x^10 + x^2 + 1
  EXPECT_EQ(FindRealRoots(ConstantFirst({1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1}), 100)
                .count,
            0);
  EXPECT_EQ(FindRealRoots({}, 100).count, 0);
  std::array<double, 11> c = {1, 1};
  c[5] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(FindRealRoots(c, 100).count, 0);
}

}  // namespace
}  // namespace dgsfm
