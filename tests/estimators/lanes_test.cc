#include "estimators/lanes.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(Lanes, LogarithmsAreThoseOfTheStandardLibrary) {
  for (double base = 1e-300; base < 1e300; base *= 1.37) {
    Lanes values;
    for (int k = 0; k < kNumLanes; ++k) values[k] = base * (1 + 0.04 * k);
    const Lanes logs = Log(values);
    for (int k = 0; k < kNumLanes; ++k) {
      const double expected = std::log(values[k]);
      // Two units in the last place; near one the terms of the sum are small.
      EXPECT_NEAR(logs[k], expected, 4.5e-16 * std::abs(expected) + 2.3e-16)
          << values[k];
    }
  }
}

TEST(Lanes, LogarithmsNearOneAreExactToRounding) {
  const Lanes values = {
      1, 1 + 1e-15, 1 - 1e-15, 1 + 1e-8, 1 - 1e-8, 1.4142, 0.7072, 1.5};
  const Lanes logs = Log(values);
  for (int k = 0; k < kNumLanes; ++k) {
    const double expected = std::log(values[k]);
    EXPECT_NEAR(logs[k], expected, 4.5e-16 * std::abs(expected)) << values[k];
  }
}

TEST(Lanes, SumsAndRootsAreThoseOfEachLane) {
  Lanes values;
  FloatLanes floats;
  for (int k = 0; k < kNumLanes; ++k) values[k] = k * k;
  for (int k = 0; k < kNumFloatLanes; ++k) floats[k] = static_cast<float>(k);
  EXPECT_EQ(Sum(values), 140);
  EXPECT_EQ(Sum(Sqrt(values)), 28);
  EXPECT_EQ(Sum(floats), 120);
  EXPECT_EQ(Sum(Max(values, Lanes{} + 10.0)), 4 * 10 + 16 + 25 + 36 + 49);
}

}  // namespace
}  // namespace dgsfm
