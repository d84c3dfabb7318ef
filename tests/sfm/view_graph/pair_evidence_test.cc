#include "sfm/view_graph/pair_evidence.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

PairGeometry Pair(size_t num_inliers, size_t num_matches, bool has_scale) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.num_matches = num_matches;
  pair.has_scale = has_scale;
  pair.inlier_matches.resize(num_inliers);
  pair.depth_verified.resize(num_inliers, has_scale);
  return pair;
}

TEST(PairEvidence, GrowsWithEveryKindOfSupport) {
  const double weak = PairProbability(Pair(20, 80, false));
  EXPECT_GT(PairProbability(Pair(20, 80, true)), weak);
  EXPECT_GT(PairProbability(Pair(20, 40, false)), weak);
  EXPECT_GT(PairProbability(Pair(200, 800, false)), weak);
}

TEST(PairEvidence, IsTheCostOfCallingThePairWrong) {
  const PairGeometry pair = Pair(50, 100, true);
  EXPECT_NEAR(PairEvidence(pair), -std::log(1 - PairProbability(pair)), 1e-12);
}

TEST(PairEvidence, StaysFiniteAndPositiveAtTheEnds) {
  for (const PairGeometry& pair : {Pair(0, 0, false),
                                   Pair(1, 100000, false),
                                   Pair(100000, 100000, true)}) {
    EXPECT_GT(PairEvidence(pair), 0);
    EXPECT_TRUE(std::isfinite(PairEvidence(pair)));
  }
}

}  // namespace
}  // namespace dgsfm
