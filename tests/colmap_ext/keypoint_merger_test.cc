#include "colmap_ext/keypoint_merger.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;

TEST(KeypointMerger, MergesWithinTheRadiusAcrossPairsOnly) {
  KeypointMerger merger(0.25);
  EXPECT_THAT(merger.AddPair({{10, 10}, {10.1f, 10}, {20, 20}}),
              ElementsAre(0, 1, 2));
  // The nearest one, once: the second point finds the next.
  EXPECT_THAT(merger.AddPair({{10.02f, 10}, {10.03f, 10}, {20.2f, 20.2f}}),
              ElementsAre(0, 1, 3));
  EXPECT_THAT(merger.AddPair({{20.25f, 20}, {9.999f, 9.999f}}),
              ElementsAre(3, 0));
  ASSERT_EQ(merger.Keypoints().size(), 4);
  EXPECT_EQ(merger.Keypoints()[0], Eigen::Vector2f(10, 10));
  EXPECT_EQ(merger.Keypoints()[3], Eigen::Vector2f(20.2f, 20.2f));
}

TEST(KeypointMerger, RadiusZeroMergesEqualPositions) {
  KeypointMerger merger(0);
  merger.AddPair({{1.5f, 2.5f}});
  EXPECT_THAT(merger.AddPair({{1.5f, 2.5f}, {1.50001f, 2.5f}}),
              ElementsAre(0, 1));
}

TEST(KeypointMerger, AgreesWithSearchAmongAll) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> position(-2, 6);
  constexpr float kRadius = 0.25f;
  KeypointMerger merger(kRadius);
  std::vector<Eigen::Vector2f> keypoints;
  for (int pair = 0; pair < 20; ++pair) {
    std::vector<Eigen::Vector2f> points;
    for (int i = 0; i < 40; ++i) {
      points.emplace_back(position(random), position(random));
    }
    const std::vector<uint32_t> indices = merger.AddPair(points);
    std::vector<bool> is_used(keypoints.size() + points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      size_t nearest = keypoints.size();
      float distance = std::numeric_limits<float>::max();
      for (size_t k = 0; k < keypoints.size(); ++k) {
        const float d = (keypoints[k] - points[i]).norm();
        if (!is_used[k] && d <= kRadius && d < distance) {
          distance = d;
          nearest = k;
        }
      }
      if (nearest == keypoints.size()) keypoints.push_back(points[i]);
      is_used[nearest] = true;
      ASSERT_EQ(indices[i], nearest);
    }
  }
  EXPECT_EQ(merger.Keypoints(), keypoints);
}

TEST(KeypointMerger, RefusesNonsense) {
  EXPECT_THROW(KeypointMerger(-1), std::invalid_argument);
  KeypointMerger merger(1);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(merger.AddPair({{nan, 1}}), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
