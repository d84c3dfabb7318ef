#include "estimators/position_alignment.h"

#include "colmap_ext/synthetic/random_stream.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

Eigen::Vector3d RandomVector(double scale, RandomStream* random) {
  return scale *
         Eigen::Vector3d(random->Normal(), random->Normal(), random->Normal());
}

Similarity3d Truth() {
  Similarity3d truth;
  truth.scale = 3;
  truth.rotation = Eigen::Quaterniond(
      Eigen::AngleAxisd(2, Eigen::Vector3d(1, 2, 3) / std::sqrt(14.0)));
  truth.translation = Eigen::Vector3d(10, 20, 30);
  return truth;
}

// Positions of standard deviation 1, four in ten of them off by 50.
TEST(PositionAlignment, StandsFourWrongOfTen) {
  RandomStream random(0, 0);
  std::vector<PositionMatch> matches;
  for (int i = 0; i < 200; ++i) {
    PositionMatch match;
    match.source = RandomVector(10, &random);
    match.target = Truth() * match.source + RandomVector(1, &random);
    if (i % 5 < 2) match.target += 50 * RandomVector(1, &random).normalized();
    matches.push_back(match);
  }
  const auto found = AlignPositions({}, matches, std::nullopt);
  ASSERT_TRUE(found);
  // Three standard deviations of the mean of 120 positions.
  EXPECT_LT((found->target_from_source * Eigen::Vector3d::Zero() -
             Truth().translation)
                .norm(),
            0.4);
  EXPECT_NEAR(std::log(found->target_from_source.scale / 3),
              0,
              4 * found->log_scale_stddev);
  EXPECT_LT(found->log_scale_stddev, 0.01);
  EXPECT_NEAR(double(found->num_inliers), 120, 6);
}

TEST(PositionAlignment, VerticalHoldsTheTurnAboutALine) {
  std::vector<PositionMatch> matches;
  for (int i = 0; i < 20; ++i) {
    PositionMatch match;
    match.source = Eigen::Vector3d(i, 0, 0);
    match.target = Truth() * match.source;
    matches.push_back(match);
  }
  DirectionMatch up;
  up.source = Eigen::Vector3d::UnitZ();
  up.target = Truth().rotation * up.source;
  up.stddev_rad = 0.1;
  const auto found = AlignPositions({}, matches, up);
  ASSERT_TRUE(found);
  EXPECT_LT(
      found->target_from_source.rotation.angularDistance(Truth().rotation),
      1e-6);
  EXPECT_LT(found->rotation_stddev_rad, 0.2);
}

TEST(PositionAlignment, NeedsThreePositionsOfDifferentPlaces) {
  std::vector<PositionMatch> matches(2);
  EXPECT_FALSE(AlignPositions({}, matches, std::nullopt));
  matches.resize(5);
  EXPECT_FALSE(AlignPositions({}, matches, std::nullopt));
}

}  // namespace
}  // namespace dgsfm
