#include "sfm/joining/position_placement.h"

#include "colmap_ext/pose_access.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;

constexpr int kNumImages = 20;
// The scale of the positions over that of the model.
constexpr double kScale = 1.5;

class PositionPlacement : public testing::Test {
 protected:
  void SetUp() override {
    colmap::Camera camera;
    camera.SetCameraId(1);
    camera.SetModelIdFromName("SIMPLE_PINHOLE");
    camera.SetWidth(800);
    camera.SetHeight(600);
    camera.SetParams({600, 400, 300});
    model_.poses.AddCamera(camera);
    for (int i = 0; i < kNumImages; ++i) {
      colmap::Image image;
      image.SetImageId(i + 1);
      image.SetCameraId(1);
      // The camera is level and looks along y.
      Eigen::Matrix3d rotation;
      rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
      SetCamFromWorld({Eigen::Quaterniond(rotation), Eigen::Vector3d::Zero()},
                      &image);
      SetCenterInWorld(CenterOf(i), &image);
      model_.poses.AddImage(image);
      model_.poses.RegisterImage(i + 1);
      model_.image_ids.push_back(i + 1);
    }
    model_.points = {{1, 2, 3}};
  }

  static Eigen::Vector3d CenterOf(int image) {
    return {
        10 * std::cos(0.3 * image), 10 * std::sin(0.3 * image), 0.1 * image};
  }

  static Eigen::Vector3d PositionOf(const Eigen::Vector3d& center) {
    return kScale * center + Eigen::Vector3d(100, 50, 0);
  }

  void SetPositions(double stddev_m) {
    for (int i = 0; i < kNumImages; ++i) {
      positions_[i + 1].position = PositionOf(CenterOf(i));
      positions_[i + 1].covariance =
          stddev_m * stddev_m * Eigen::Matrix3d::Identity();
    }
  }

  ModelGeoreference Place(bool has_scale) {
    return PlaceAtPositions({}, positions_, has_scale, &model_, &warnings_);
  }

  JoinedModel model_;
  PosePriors positions_;
  std::vector<std::string> warnings_;
};

TEST_F(PositionPlacement, TakesTheFrameAndScaleOfThePositions) {
  SetPositions(0.1);
  const ModelGeoreference result = Place(false);
  EXPECT_TRUE(result.is_georeferenced);
  EXPECT_EQ(result.scale_source, ScaleSource::POSITIONS);
  EXPECT_EQ(result.num_inliers, kNumImages);
  EXPECT_LT(result.median_horizontal_error_m, 1e-6);
  EXPECT_LT((model_.points[0] - PositionOf({1, 2, 3})).norm(), 1e-6);
  EXPECT_TRUE(warnings_.empty());
}

// Rigs, or depth maps where positions are uncertain, hold the scale.
TEST_F(PositionPlacement, KeepsABetterScale) {
  SetPositions(0.1);
  EXPECT_EQ(Place(true).scale_source, ScaleSource::RIGS);
  const auto size = [&] {
    const auto center = [&](colmap::image_t image_id) {
      return CamFromWorld(model_.poses.Image(image_id)).TargetOriginInSource();
    };
    return (center(1) - center(10)).norm();
  };
  EXPECT_NEAR(size(), (CenterOf(0) - CenterOf(9)).norm(), 1e-9);
  SetPositions(3);
  EXPECT_EQ(Place(false).scale_source, ScaleSource::DEPTH);
  EXPECT_NEAR(size(), (CenterOf(0) - CenterOf(9)).norm(), 1e-9);
}

TEST_F(PositionPlacement, WarnsOfPositionsThatHoldNothing) {
  EXPECT_FALSE(Place(false).is_georeferenced);
  EXPECT_TRUE(warnings_.empty());
  SetPositions(0.1);
  for (auto& [image_id, prior] : positions_) prior.position.setZero();
  EXPECT_FALSE(Place(false).is_georeferenced);
  ASSERT_EQ(warnings_.size(), 1);
  EXPECT_THAT(warnings_[0], HasSubstr("not used for a model of 20 images"));
  EXPECT_EQ(model_.points[0], Eigen::Vector3d(1, 2, 3));
}

}  // namespace
}  // namespace dgsfm
