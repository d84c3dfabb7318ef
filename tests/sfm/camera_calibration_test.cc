#include "sfm/camera_calibration.h"

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

KeypointDepthMap DepthsWithFocal(double focal_length_px) {
  KeypointDepthMap depths;
  depths[1].focal_length_px = focal_length_px;
  depths[2].focal_length_px = 10;
  return depths;
}

PairGeometries OnePair(double focal_length_px) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.focal_length1_px = focal_length_px;
  pair.focal_length2_px = 500;
  pair.estimated_focal1 = true;
  return {{PairIdOfImages(1, 2), pair}};
}

TEST(CalibrateCameras, PairsGoBeforeTheDepthModelAndThatBeforeTheGuess) {
  struct Case {
    PairGeometries pairs;
    KeypointDepthMap depths;
    FocalSource source;
    double focal_length_px;
  };
  const std::vector<Case> cases = {
      {OnePair(700), DepthsWithFocal(600), FocalSource::PAIRS, 700},
      {{}, DepthsWithFocal(600), FocalSource::DEPTH_MODEL, 600},
      {{}, DepthsWithFocal(0), FocalSource::DEFAULT, 500},
      {{}, {}, FocalSource::DEFAULT, 500}};
  for (const Case& c : cases) {
    Scene scene = TwoCameras();
    const auto focals = CalibrateCameras(c.pairs, c.depths, {}, &scene);
    EXPECT_EQ(focals.at(1).source, c.source);
    // Rounding of logarithms.
    EXPECT_NEAR(focals.at(1).focal_length_px, c.focal_length_px, 1e-9);
    EXPECT_EQ(scene.cameras.at(1).MeanFocalLength(),
              focals.at(1).focal_length_px);
    EXPECT_EQ(focals.at(2).source, FocalSource::PRIOR);
    EXPECT_EQ(scene.cameras.at(2).MeanFocalLength(), 500);
  }
}

}  // namespace
}  // namespace dgsfm
