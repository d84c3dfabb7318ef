#include "estimators/solvers/polynomial.h"

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// The monic polynomial with these roots.
template <size_t N>
Polynomial<N + 1> FromRoots(const std::array<double, N>& roots) {
  Polynomial<N + 1> product{1};
  for (size_t n = 0; n < N; ++n) {
    for (size_t i = n + 1; i > 0; --i) {
      product[i] = product[i - 1] - roots[n] * product[i];
    }
    product[0] *= -roots[n];
  }
  return product;
}

template <size_t N>
void ExpectRoots(const Polynomial<N>& c,
                 double max_root,
                 const std::vector<double>& expected,
                 double tolerance) {
  const RealRoots<N> roots = FindRealRoots(c, max_root);
  ASSERT_EQ(roots.count, static_cast<int>(expected.size()));
  for (int i = 0; i < roots.count; ++i) {
    EXPECT_NEAR(roots.values[i], expected[i], tolerance);
  }
}

TEST(FindRealRoots, FindsTheRootsOfRandomQuartics) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-3, 3);
  for (int trial = 0; trial < 1000; ++trial) {
    std::array<double, 4> roots;
    for (double& root : roots) root = uniform(random);
    std::sort(roots.begin(), roots.end());
    double gap = 1;
    for (int i = 1; i < 4; ++i) gap = std::min(gap, roots[i] - roots[i - 1]);
    // Roots that are closer are nearly double ones.
    if (gap < 0.05) continue;
    // Rounding of the coefficients, times up to 1 / gap^3.
    ExpectRoots(FromRoots(roots),
                100,
                {roots.begin(), roots.end()},
                /*tolerance=*/1e-8);
  }
}

TEST(FindRealRoots, LeavesOutComplexRoots) {
  ExpectRoots(Polynomial<3>{1, 0, 1}, 100, {}, 0);
  // (x - 2) (x^2 + 1)
  ExpectRoots(Polynomial<4>{-2, 1, -2, 1}, 100, {2}, 1e-12);
  // (x + 3) (x + 0.5) (x - 0.1) (x - 2) (x^2 + 1)^3
  const Polynomial<3> no_root = {1, 0, 1};
  ExpectRoots(FromRoots<4>({-3, -0.5, 0.1, 2}) * no_root * no_root * no_root,
              100,
              {-3, -0.5, 0.1, 2},
              1e-11);
}

TEST(FindRealRoots, SeparatesRootsThatAreClose) {
  const Polynomial<3> no_root = {1, 0, 1};
  ExpectRoots(FromRoots<6>({-3, -0.5, -1e-3, 1e-3, 0.1, 2}) * no_root * no_root,
              100,
              {-3, -0.5, -1e-3, 1e-3, 0.1, 2},
              // The two roots near zero are badly conditioned.
              1e-11);
}

TEST(FindRealRoots, LeadingCoefficientsOfZeroLowerTheDegree) {
  ExpectRoots(Polynomial<3>{-4, 2, 0}, 100, {2}, 1e-13);
  ExpectRoots(Polynomial<5>{2, -3, 1, 0, 1e-30}, 100, {1, 2}, 1e-12);
  ExpectRoots(Polynomial<3>{}, 100, {}, 0);
}

TEST(FindRealRoots, FindsTenRootsInOrder) {
  const std::array<double, 10> roots = {
      -1.9, -1.4, -1, -0.5, -0.1, 0.3, 0.6, 1.1, 1.5, 1.8};
  // Ten roots in an interval of four: coefficients are up to 10, rounding is
  // amplified by about 1e4.
  ExpectRoots(FromRoots(roots), 2, {roots.begin(), roots.end()}, 1e-10);
}

TEST(FindRealRoots, KeepsToTheInterval) {
  const auto c = FromRoots<10>({-4, -3.5, -3, -2.5, 0.6, 1.1, 2.5, 3, 3.5, 4});
  // Products of up to nine differences amplify rounding by about 1e5.
  ExpectRoots(c, 2, {0.6, 1.1}, 1e-9);
  EXPECT_EQ(FindRealRoots(c, 5.1).count, 10);
}

TEST(FindRealRoots, NothingOfWhatIsNotANumber) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(FindRealRoots(Polynomial<4>{0, 0, kNan, 1}, 100).count, 0);
  EXPECT_EQ(FindRealRoots(Polynomial<5>{1, 0, 0, 0, kNan}, 100).count, 0);
}

}  // namespace
}  // namespace dgsfm
