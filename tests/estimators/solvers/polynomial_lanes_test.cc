#include "estimators/solvers/polynomial_lanes.h"

#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

template <size_t N>
void SetLane(const Polynomial<N>& c, int lane, LanePolynomial<N>* p) {
  for (size_t i = 0; i < N; ++i) p->c[i][lane] = c[i];
}

// The roots of a lane are those that the derivatives give.
template <size_t N>
void ExpectEqualRoots(const LaneRoots<N>& roots,
                      int lane,
                      const Polynomial<N>& c,
                      double tolerance) {
  const RealRoots<N> expected = FindRealRoots(c);
  int count = 0;
  for (int i = 0; i < roots.count; ++i) {
    const double root = roots.values[i][lane];
    if (std::isnan(root)) continue;
    ASSERT_LT(count, expected.count);
    EXPECT_NEAR(root, expected.values[count++], tolerance);
  }
  EXPECT_EQ(count, expected.count);
}

TEST(LaneRoots, AreThoseOfTheDerivatives) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 200; ++trial) {
    std::array<Polynomial<11>, kNumLanes> polynomials;
    LanePolynomial<11> p;
    for (int lane = 0; lane < kNumLanes; ++lane) {
      for (double& value : polynomials[lane]) value = normal(random);
      SetLane(polynomials[lane], lane, &p);
    }
    const LaneRoots<11> roots = FindRealRoots(p);
    for (int lane = 0; lane < kNumLanes; ++lane) {
      // Rounding of roots that are close to each other.
      ExpectEqualRoots(roots, lane, polynomials[lane], 1e-9);
    }
  }
}

TEST(LaneRoots, NeedNoLinearQuotients) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kRootTwo = 1.4142135623730951;
  LanePolynomial<4> p;
  const std::array<Polynomial<4>, kNumLanes> polynomials = {
      // Cubic, quadratic, linear, constant, zero.
      Polynomial<4>{0, -2, 0, 1},
      Polynomial<4>{-2, 0, 1, 0},
      Polynomial<4>{-2, 1, 0, 0},
      Polynomial<4>{1, 0, 0, 0},
      Polynomial<4>{},
      // x^3: the remainder is zero. Three roots near zero, a far one.
      Polynomial<4>{0, 0, 0, 1},
      Polynomial<4>{0, -1e-6, 0, 1},
      Polynomial<4>{-1000, 1, 0, 0}};
  for (int lane = 0; lane < kNumLanes; ++lane) {
    SetLane(polynomials[lane], lane, &p);
  }
  const LaneRoots<4> roots = FindRealRoots(p);
  for (const int lane : {1, 2, 3, 4, 6, 7}) {
    ExpectEqualRoots(roots, lane, polynomials[lane], 1e-12);
  }
  ASSERT_EQ(roots.count, 3);
  EXPECT_NEAR(roots.values[0][0], -kRootTwo, 1e-12);
  EXPECT_NEAR(roots.values[1][0], 0, 1e-12);
  EXPECT_NEAR(roots.values[2][0], kRootTwo, 1e-12);
  for (Lanes& coefficient : p.c) coefficient = kNan + Lanes{};
  const LaneRoots<4> none = FindRealRoots(p);
  for (int i = 0; i < none.count; ++i) {
    for (int lane = 0; lane < kNumLanes; ++lane) {
      EXPECT_TRUE(std::isnan(none.values[i][lane]));
    }
  }
}

}  // namespace
}  // namespace dgsfm
