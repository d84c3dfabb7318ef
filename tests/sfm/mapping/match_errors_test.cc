#include "sfm/mapping/match_errors.h"

#include "colmap_ext/pose_access.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr double kFocalLengthPx = 500;

// Two images, the second with its centre at `center2` and turned about y.
class TwoImages {
 public:
  explicit TwoImages(const Eigen::Vector3d& center2) {
    colmap::Camera camera;
    camera.SetCameraId(1);
    camera.SetModelIdFromName("SIMPLE_PINHOLE");
    camera.SetWidth(800);
    camera.SetHeight(600);
    camera.SetParams({kFocalLengthPx, 400, 300});
    model_.AddCamera(camera);
    const Eigen::Quaterniond rotation(
        Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()));
    poses_[1] = Rigid3d(rotation, rotation * -center2);
    for (int i = 0; i < 2; ++i) {
      colmap::Image image;
      image.SetImageId(i + 1);
      image.SetCameraId(1);
      image.SetPoints2D(PlacesIn(i));
      SetCamFromWorld(poses_[i], &image);
      model_.AddImage(image);
      model_.RegisterImage(i + 1);
    }
  }

  double Error(size_t point1, size_t point2) const {
    const auto keypoints = UndistortKeypoints(model_, 1);
    const MatchErrors error_px(model_, model_.Image(1), model_.Image(2));
    return error_px(keypoints.at(1)[point1], keypoints.at(2)[point2]);
  }

  colmap::FeatureMatches Agreeing(const colmap::FeatureMatches& matches) const {
    const auto keypoints = UndistortKeypoints(model_, 1);
    const MatchErrors error_px(model_, model_.Image(1), model_.Image(2));
    return MatchesOfPoses(
        error_px, keypoints.at(1), keypoints.at(2), matches, 1);
  }

 private:
  // Two points, and the first once more 2 px lower in the second image.
  std::vector<Eigen::Vector2d> PlacesIn(int image) const {
    std::vector<Eigen::Vector2d> places;
    for (const Eigen::Vector3d& point :
         {Eigen::Vector3d(0.3, 0.2, 4), Eigen::Vector3d(-0.5, -0.4, 6)}) {
      places.push_back(kFocalLengthPx * (poses_[image] * point).hnormalized() +
                       Eigen::Vector2d(400, 300));
    }
    places.push_back(places[0] + Eigen::Vector2d(0, 2 * image));
    return places;
  }

  Rigid3d poses_[2];
  colmap::Reconstruction model_;
};

TEST(MatchErrors, AreSampsonErrorsOfTheEpipolarLine) {
  const TwoImages images({1, 0, 0});
  EXPECT_NEAR(images.Error(0, 0), 0, 1e-9);
  EXPECT_NEAR(images.Error(1, 1), 0, 1e-9);
  // Lines are nearly level: each key point has half of the 2 px.
  EXPECT_NEAR(images.Error(2, 2), M_SQRT2, 0.1);
  EXPECT_GT(images.Error(0, 1), 20);
}

TEST(MatchErrors, AreDistancesOfTurnedKeypointsAtOneCenter) {
  const TwoImages images({0, 0, 0});
  EXPECT_NEAR(images.Error(1, 1), 0, 1e-9);
  EXPECT_NEAR(images.Error(2, 2), M_SQRT2, 1e-9);
  // The other point is elsewhere on what would be a level line.
  EXPECT_GT(images.Error(0, 1), 50);
}

TEST(MatchErrors, MatchesOfPosesHaveEachKeypointOnce) {
  const TwoImages images({1, 0, 0});
  const colmap::FeatureMatches agreeing =
      images.Agreeing({{1, 1}, {0, 0}, {2, 0}, {0, 1}, {2, 2}});
  ASSERT_EQ(agreeing.size(), 2);
  EXPECT_EQ(agreeing[0].point2D_idx1, 1);
  EXPECT_EQ(agreeing[1].point2D_idx1, 0);
  EXPECT_EQ(agreeing[1].point2D_idx2, 0);
}

}  // namespace
}  // namespace dgsfm
