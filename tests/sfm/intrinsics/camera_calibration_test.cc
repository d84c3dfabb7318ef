#include "sfm/intrinsics/camera_calibration.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Camera and image 1 of 500 px as the guess, 2 with this focal length as prior.
Scene TwoCameras() {
  Scene scene;
  for (const colmap::camera_t id : {1, 2}) {
    colmap::Camera camera;
    camera.SetCameraId(id);
    camera.InitializeWithName("SIMPLE_PINHOLE", 500, 640, 480);
    camera.SetPriorFocalLength(id == 2);
    scene.cameras.emplace(id, camera);
    colmap::Image image;
    image.SetImageId(id);
    image.SetCameraId(id);
    scene.images.emplace(id, image);
  }
  return scene;
}

PairGeometries OnePair(double focal_length_px) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.focal_length1_px = focal_length_px;
  pair.focal_length2_px = 500;
  pair.estimated_focal1 = true;
  return {{PairIdOfImages(1, 2), pair}};
}

TEST(AverageFocalsOfCameras, PairsGoBeforeTheGuess) {
  for (const bool has_pair : {true, false}) {
    Scene scene = TwoCameras();
    const auto focals = AverageFocalsOfCameras(
        has_pair ? OnePair(700) : PairGeometries(), false, &scene);
    EXPECT_EQ(focals.at(1).source,
              has_pair ? FocalSource::PAIRS : FocalSource::DEFAULT);
    // Rounding of logarithms.
    EXPECT_NEAR(focals.at(1).focal_length_px, has_pair ? 700 : 500, 1e-9);
    EXPECT_EQ(scene.cameras.at(1).MeanFocalLength(),
              focals.at(1).focal_length_px);
    EXPECT_EQ(focals.at(2).source, FocalSource::PRIOR);
    EXPECT_EQ(scene.cameras.at(2).MeanFocalLength(), 500);
  }
}

TEST(AverageFocalsOfCameras, ExifStandsInForPairsAndIsAveragedWithThem) {
  // 600 px for a diagonal of 800 px.
  const ImageExif exif = {"camera", 0.75};
  Scene scene = TwoCameras();
  scene.exif[1] = scene.exif[2] = exif;
  auto focals = AverageFocalsOfCameras({}, false, &scene);
  EXPECT_EQ(focals.at(1).source, FocalSource::EXIF);
  // Rounding of logarithms.
  EXPECT_NEAR(focals.at(1).focal_length_px, 600, 1e-9);
  EXPECT_EQ(scene.cameras.at(2).MeanFocalLength(), 500);

  // One estimate with a deviation of 2 % against 5 %: 4 / 29 of the way.
  scene = TwoCameras();
  scene.exif[1] = exif;
  focals = AverageFocalsOfCameras(OnePair(640), false, &scene);
  EXPECT_EQ(focals.at(1).source, FocalSource::PAIRS);
  EXPECT_NEAR(focals.at(1).focal_length_px,
              640 * std::pow(600.0 / 640.0, 4.0 / 29.0),
              1e-9);

  // EXIF data of a crop: 17 % are more than two deviations.
  scene = TwoCameras();
  scene.exif[1] = exif;
  focals = AverageFocalsOfCameras(OnePair(720), false, &scene);
  EXPECT_NEAR(focals.at(1).focal_length_px, 720, 1e-9);
}

// Six cameras in a row of pairs, the last of which has no estimate.
TEST(AverageFocalsOfCameras, RelatedCamerasShareTheirEstimates) {
  Scene scene;
  PairGeometries pairs;
  for (colmap::camera_t id = 1; id <= 6; ++id) {
    colmap::Camera camera;
    camera.SetCameraId(id);
    camera.InitializeWithName("SIMPLE_PINHOLE", 500, 640, 480);
    scene.cameras.emplace(id, camera);
    colmap::Image image;
    image.SetImageId(id);
    image.SetCameraId(id);
    scene.images.emplace(id, image);
  }
  const std::vector<double> focal_lengths_px = {700, 720, 690, 710, 700};
  for (colmap::image_t id = 1; id <= 5; ++id) {
    for (const colmap::image_t other : {id % 5 + 1, (id + 1) % 5 + 1}) {
      // Estimates of one camera are 3 % too small or too large.
      const double factor = other == id % 5 + 1 ? 0.97 : 1.03;
      PairGeometry& pair = pairs[PairIdOfImages(id, other)];
      pair.status = PairStatus::VALID;
      pair.cam2_from_cam1.translation = Eigen::Vector3d::UnitX();
      pair.focal_length1_px =
          factor * focal_lengths_px[std::min(id, other) - 1];
      pair.focal_length2_px =
          factor * focal_lengths_px[std::max(id, other) - 1];
      pair.estimated_focal1 = pair.estimated_focal2 = true;
    }
  }
  const auto focals = AverageFocalsOfCameras(pairs, true, &scene);
  for (const colmap::camera_t id : {1, 2, 3, 4, 5}) {
    EXPECT_EQ(focals.at(id).source, FocalSource::PAIRS);
    // All but the smallest spread that populations have.
    EXPECT_NEAR(
        focals.at(id).focal_length_px / focals.at(1).focal_length_px, 1, 0.01);
  }
  EXPECT_NE(focals.at(6).source, FocalSource::DEFAULT);
  EXPECT_NEAR(
      scene.cameras.at(6).MeanFocalLength(), focals.at(1).focal_length_px, 10);
}

}  // namespace
}  // namespace dgsfm
