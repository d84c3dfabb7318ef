#include "estimators/two_view/depth_consistency.h"

#include "tests/estimators/two_view_scene.h"

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

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
  matches.points2[0] += Eigen::Vector2d(200, 200);
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

TEST(DepthConsistency, DepthErrorExplainsPositionAlongEpipolarLineOnly) {
  // Translation along x by half the depth: a point at depth 2 moves by 250 px,
  // and by 25 px more or less with 10 % of depth.
  TwoViewModel model;
  model.translation.x() = 1;
  model.focal1 = model.focal2 = 500;
  DepthMatches matches;
  matches.points1 = {{0, 0}, {0, 0}};
  matches.points2 = {{275, 0}, {250, 25}};
  matches.depths1 = {2, 2};
  matches.depths2 = {2, 2};
  const auto check = [&](bool tolerate_depth_error) {
    DepthConsistencyOptions options;
    options.tolerate_depth_error = tolerate_depth_error;
    return CheckDepthConsistency(
        matches,
        Rigid3d(Eigen::Quaterniond::Identity(), model.translation),
        model.scale,
        model.focal1,
        model.focal2,
        options);
  };
  EXPECT_EQ(check(true)[0], DepthVerdict::CONSISTENT);
  EXPECT_EQ(check(true)[1], DepthVerdict::INCONSISTENT);
  EXPECT_EQ(check(false)[0], DepthVerdict::INCONSISTENT);
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
  DepthMatches swapped = matches;
  std::swap(swapped.points1, swapped.points2);
  std::swap(swapped.depths1, swapped.depths2);
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
