#include "estimators/intrinsics/camera_grouping.h"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Log focal length, principal point [px], distortion.
constexpr int kNumParams = 4;
const Eigen::Vector4d kTruth(std::log(700), 400, 300, -0.02);
const Eigen::Vector4d kStddevs(0.002, 2, 2, 0.003);

// Estimates of cameras with the given truth, whose errors are independent up to
// one that all have in common and that tells nothing about differences.
CameraEstimates EstimatesOf(const std::vector<Eigen::Vector4d>& truths,
                            int seed = 1) {
  CameraEstimates estimates;
  estimates.num_params_per_camera = kNumParams;
  const auto size = Eigen::Index(kNumParams * truths.size());
  estimates.params.resize(size);
  estimates.covariance = Eigen::MatrixXd::Zero(size, size);
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  Eigen::Vector4d common;
  for (double& value : common) value = 3 * normal(generator);
  for (Eigen::Index i = 0; i < size; ++i) {
    const Eigen::Index param = i % kNumParams;
    estimates.params(i) = truths[i / kNumParams](param) +
                          kStddevs(param) * (common(param) + normal(generator));
    for (Eigen::Index j = param; j < size; j += kNumParams) {
      estimates.covariance(i, j) =
          kStddevs(param) * kStddevs(param) * (i == j ? 10 : 9);
    }
  }
  return estimates;
}

std::vector<Eigen::Vector4d> Repeated(int count, const Eigen::Vector4d& truth) {
  return std::vector<Eigen::Vector4d>(count, truth);
}

TEST(GroupCameras, OneCameraIsOneGroupWithoutSpread) {
  int count = 0;
  for (int seed = 0; seed < 100; ++seed) {
    const auto groups = GroupCameras(CameraGroupingOptions(),
                                     EstimatesOf(Repeated(12, kTruth), seed));
    count += groups.size() == 1 && groups[0].cameras.size() == 12 &&
             groups[0].stddevs.isZero(0);
  }
  // Each of four parameters seems to spread in 1 % of the cases, and three
  // standard deviations of that.
  EXPECT_GE(count, 90);
}

TEST(GroupCameras, ZoomsOfOneCameraAreGroupsOfTheirOwn) {
  std::vector<Eigen::Vector4d> truths;
  for (int i = 0; i < 12; ++i) {
    truths.push_back(kTruth + Eigen::Vector4d(i % 2 == 0 ? 0 : 0.05, 0, 0, 0));
  }
  const auto groups =
      GroupCameras(CameraGroupingOptions(), EstimatesOf(truths));
  ASSERT_EQ(groups.size(), 2);
  EXPECT_EQ(groups[0].cameras, std::vector<int>({0, 2, 4, 6, 8, 10}));
  EXPECT_EQ(groups[1].cameras, std::vector<int>({1, 3, 5, 7, 9, 11}));
}

TEST(GroupCameras, SpreadOfFocalLengthsIsMeasured) {
  // Focused anew for each image; the rest is the same.
  std::mt19937 generator(2);
  std::normal_distribution<double> focus(0, 0.006);
  std::vector<Eigen::Vector4d> truths = Repeated(20, kTruth);
  for (Eigen::Vector4d& truth : truths) truth(0) += focus(generator);
  const auto groups =
      GroupCameras(CameraGroupingOptions(), EstimatesOf(truths));
  ASSERT_EQ(groups.size(), 1);
  // The extremes may be taken for other zooms.
  EXPECT_GE(groups[0].cameras.size(), 15);
  // Three standard deviations of that of 20 values: 0.48.
  EXPECT_NEAR(groups[0].stddevs(0), 0.006, 0.5 * 0.006);
}

TEST(GroupCameras, CropsLeaveTheirGroup) {
  std::vector<Eigen::Vector4d> truths = Repeated(10, kTruth);
  truths[3](1) += 80;
  truths[7](2) -= 60;
  const auto groups =
      GroupCameras(CameraGroupingOptions(), EstimatesOf(truths));
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].cameras, std::vector<int>({0, 1, 2, 4, 5, 6, 8, 9}));
}

TEST(GroupCameras, UnrelatedCamerasHaveNoGroup) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> uniform(-0.35, 0.35);
  for (int repetition = 0; repetition < 20; ++repetition) {
    std::vector<Eigen::Vector4d> truths = Repeated(12, kTruth);
    for (Eigen::Vector4d& truth : truths) {
      truth(0) += uniform(generator);
      truth(3) += 0.2 * uniform(generator);
    }
    for (const SameCameras& same :
         GroupCameras(CameraGroupingOptions(), EstimatesOf(truths))) {
      // Chance neighbours would have to be three, and closer than the spread
      // that they are then given.
      EXPECT_LE(same.cameras.size(), 3);
      EXPECT_GT(same.stddevs(0) + same.stddevs(3), 0);
    }
  }
}

TEST(GroupCameras, WeakEstimatesAreNoEvidence) {
  // Log focal lengths known to half of what unrelated cameras differ by.
  CameraEstimates estimates = EstimatesOf(Repeated(6, kTruth));
  ASSERT_EQ(GroupCameras(CameraGroupingOptions(), estimates).size(), 1);
  for (int i = 0; i < 6; ++i) estimates.covariance(4 * i, 4 * i) = 0.06;
  EXPECT_TRUE(GroupCameras(CameraGroupingOptions(), estimates).empty());
  EXPECT_TRUE(
      GroupCameras(CameraGroupingOptions(), EstimatesOf({kTruth})).empty());
}

TEST(GroupCameras, RefusesWrongOptionsAndSizes) {
  CameraGroupingOptions options;
  options.min_odds = 0;
  EXPECT_THROW(GroupCameras(options, EstimatesOf({kTruth})),
               std::invalid_argument);
  CameraEstimates estimates = EstimatesOf({kTruth, kTruth});
  estimates.params.conservativeResize(7);
  EXPECT_THROW(GroupCameras(CameraGroupingOptions(), estimates),
               std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
