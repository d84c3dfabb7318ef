#include "estimators/depth_consistency.h"

#include "tests/estimators/two_view_scene.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TwoViewScene CreateExactScene() {
  TwoViewSceneOptions options;
  options.num_matches = 40;
  options.outlier_ratio = 0;
  options.point_stddev_px = 0;
  options.log_depth_stddev = 0;
  options.bad_depth_ratio = 0;
  return CreateTwoViewScene(options, 5);
}

std::vector<DepthVerdict> Check(const DepthMatches& matches,
                                const TwoViewModel& truth) {
  return CheckDepthConsistency(
      matches,
      Rigid3d(Eigen::Quaterniond(truth.rotation), truth.translation),
      truth.scale,
      truth.focal1,
      truth.focal2,
      DepthConsistencyOptions());
}

TEST(DepthConsistency, ExactMatchesAreConsistent) {
  const TwoViewScene scene = CreateExactScene();
  for (const DepthVerdict verdict : Check(scene.input.matches, scene.truth)) {
    EXPECT_EQ(verdict, DepthVerdict::CONSISTENT);
  }
}

TEST(DepthConsistency, WrongOrUnknownValuesAreTold) {
  const TwoViewScene scene = CreateExactScene();
  DepthMatches matches = scene.input.matches;
  matches.points2[0].x() += 13;  // threshold 12 px
  matches.points1[1].y() += 100;
  matches.depths2[2] *= 1.5;  // threshold 30 %
  matches.depths2[3] /= 1.5;
  matches.depths1[4] = 0;
  matches.depths2[5] = 0;
  matches.points2[6].x() += 1;
  matches.depths2[7] *= 1.1;
  const auto verdicts = Check(matches, scene.truth);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(verdicts[i], DepthVerdict::INCONSISTENT) << i;
  }
  EXPECT_EQ(verdicts[4], DepthVerdict::UNTESTED);
  EXPECT_EQ(verdicts[5], DepthVerdict::UNTESTED);
  EXPECT_EQ(verdicts[6], DepthVerdict::CONSISTENT);
}

TEST(DepthConsistency, PointBehindTheOtherCameraIsInconsistent) {
  DepthMatches matches;
  matches.points1 = {Eigen::Vector2d(0, 0)};
  matches.points2 = {Eigen::Vector2d(0, 0)};
  matches.depths1 = {1};
  matches.depths2 = {1};
  TwoViewModel model;
  model.translation.z() = -2;
  EXPECT_EQ(Check(matches, model)[0], DepthVerdict::INCONSISTENT);
}

TEST(DepthConsistency, VerdictsDoNotDependOnTheOrderOfViews) {
  TwoViewSceneOptions options;
  options.log_depth_stddev = 0.2;
  const TwoViewScene scene = CreateTwoViewScene(options, 6);
  const DepthMatches& matches = scene.input.matches;
  const DepthMatches swapped = {
      matches.points2, matches.points1, matches.depths2, matches.depths1};
  EXPECT_EQ(Check(matches, scene.truth), Check(swapped, scene.truth.Inverse()));
}

TEST(DepthConsistency, BrokenContractsThrow) {
  TwoViewModel model;
  model.scale = 0;
  EXPECT_THROW(Check(DepthMatches(), model), std::invalid_argument);
  DepthConsistencyOptions options;
  options.max_depth_error_ratio = -1;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_NE(error.find("max_depth_error_ratio"), std::string::npos);
}

}  // namespace
}  // namespace dgsfm
