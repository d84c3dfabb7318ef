#include "estimators/pose_metrics.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using Poses = std::map<std::string, Rigid3d>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Closed-form results of a handful of operations on numbers of size 1 to 100.
constexpr double kExact = 1e-10;
// An angle from atan2 of rounded unit vectors or quaternions [deg].
constexpr double kExactDeg = 1e-6;

Poses CreatePoses(int num_images, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  Poses poses;
  for (int i = 0; i < num_images; ++i) {
    Eigen::Quaterniond rotation;
    Eigen::Vector3d translation;
    for (double& value : rotation.coeffs()) value = normal(generator);
    for (double& value : translation) value = normal(generator);
    poses.emplace("image" + std::to_string(i),
                  Rigid3d(rotation.normalized(), translation));
  }
  return poses;
}

// The poses in a world moved by a similarity.
Poses MoveWorld(const Poses& poses, const Rigid3d& new_from_old, double scale) {
  Poses moved;
  for (const auto& [name, pose] : poses) {
    Rigid3d scaled(pose.rotation, scale * pose.translation);
    moved.emplace(name, scaled * new_from_old.Inverse());
  }
  return moved;
}

TEST(AreaUnderCurve, MatchesHandComputedAreas) {
  // Recall rises linearly from 0 at 0 to 1/2 at 1, then stays: 1/4 up to 1,
  // 1/4 + 1/2 up to 2. The error at 2 itself lies outside its threshold.
  const std::vector<double> areas = AreaUnderCurve({kInfinity, 1}, {1, 2, 0.5});
  EXPECT_NEAR(areas[0], 0, kExact);
  EXPECT_NEAR(areas[1], 100 * 0.75 / 2, kExact);
  EXPECT_NEAR(areas[2], 0, kExact);
}

TEST(AreaUnderCurve, PerfectFailedAndEmpty) {
  EXPECT_THAT(AreaUnderCurve({0, 0, 0}, {1, 5}), ElementsAre(100, 100));
  EXPECT_THAT(AreaUnderCurve({kInfinity, kInfinity}, {1}), ElementsAre(0));
  EXPECT_THAT(AreaUnderCurve({}, {1, 3}), ElementsAre(0, 0));
  EXPECT_THAT(AreaUnderCurve({1}, {}), ElementsAre());
  EXPECT_THROW(AreaUnderCurve({1}, {0}), std::invalid_argument);
}

TEST(EvaluatePoses, SimilarityOfTheTruthIsPerfect) {
  const Poses truth = CreatePoses(8, 1);
  const Rigid3d new_from_old(Eigen::Quaterniond(0.5, -0.5, 0.5, 0.5),
                             Eigen::Vector3d(1, -20, 3));
  const PoseMetrics metrics =
      EvaluatePoses(truth, MoveWorld(truth, new_from_old, 0.25));
  EXPECT_EQ(metrics.num_images, 8);
  EXPECT_EQ(metrics.num_registered, 8);
  ASSERT_EQ(metrics.relative_errors_deg.size(), 28);
  for (const double error : metrics.relative_errors_deg) {
    EXPECT_NEAR(error, 0, kExactDeg);
  }
  EXPECT_NEAR(metrics.truth_from_model_scale, 4, kExact);
  EXPECT_NEAR(metrics.rms_center_error, 0, kExact);
  EXPECT_NEAR(metrics.max_center_error, 0, kExact);
}

TEST(EvaluatePoses, RotatedCameraShowsItsAngle) {
  const Poses truth = CreatePoses(3, 2);
  Poses model = truth;
  // About its own centre: directions seen from the other cameras are right,
  // those seen from this one turn by at most as much.
  const Eigen::AngleAxisd turn(0.1, Eigen::Vector3d::UnitX());
  model["image2"] = Rigid3d(Eigen::Quaterniond(turn), Eigen::Vector3d::Zero()) *
                    model["image2"];
  const PoseMetrics metrics = EvaluatePoses(truth, model);
  const double angle_deg = 0.1 * 180 / M_PI;
  EXPECT_NEAR(metrics.median_rotation_error_deg, angle_deg, kExactDeg);
  EXPECT_NEAR(metrics.relative_errors_deg[0], 0, kExactDeg);
  EXPECT_NEAR(metrics.relative_errors_deg[1], angle_deg, kExactDeg);
  EXPECT_NEAR(metrics.relative_errors_deg[2], angle_deg, kExactDeg);
  EXPECT_NEAR(metrics.max_center_error, 0, kExact);
}

TEST(EvaluatePoses, MissingImageFailsItsPairs) {
  const Poses truth = CreatePoses(4, 3);
  Poses model = truth;
  model.erase("image1");
  model.emplace("not in the truth", Rigid3d());
  const PoseMetrics metrics = EvaluatePoses(truth, model);
  EXPECT_EQ(metrics.num_registered, 3);
  EXPECT_NEAR(AreaUnderCurve(metrics.relative_errors_deg, {5})[0],
              50,
              // Angles of 1e-6 deg move the area by their share of 5 deg.
              1e-4);
}

TEST(EvaluatePoses, CentersThatCoincideHaveNoScaleButErrors) {
  Poses truth, model;
  for (int i = 0; i < 4; ++i) {
    const std::string name = std::to_string(i);
    truth[name].translation = Eigen::Vector3d(i % 2 == 0 ? 1 : -1, 0, 0);
    model[name] = Rigid3d();
  }
  const PoseMetrics metrics = EvaluatePoses(truth, model);
  EXPECT_EQ(metrics.truth_from_model_scale, 0);
  EXPECT_NEAR(metrics.rms_center_error, 1, kExact);
  EXPECT_NEAR(metrics.median_translation_error_deg, 180, kExact);
}

TEST(EvaluatePoses, FewOrNoImagesGiveZeros) {
  for (const int num_images : {0, 1, 2}) {
    const Poses truth = CreatePoses(num_images, 4);
    for (const Poses& model : {truth, Poses()}) {
      const PoseMetrics metrics = EvaluatePoses(truth, model);
      EXPECT_EQ(metrics.relative_errors_deg.size(), num_images == 2 ? 1 : 0);
      EXPECT_NEAR(metrics.median_rotation_error_deg, 0, kExactDeg);
      EXPECT_EQ(metrics.truth_from_model_scale, 0);
      EXPECT_EQ(metrics.rms_center_error, 0);
    }
  }
}

}  // namespace
}  // namespace dgsfm
