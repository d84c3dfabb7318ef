#include "sfm/intrinsics/prior_trust.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

colmap::Camera ExifCamera(const std::string& model) {
  colmap::Camera camera;
  camera.SetCameraId(1);
  camera.InitializeWithName(model, 700, 641, 480);
  camera.SetPriorFocalLength(true);
  return camera;
}

TEST(LooksLikeExif, CamerasAsTheFeatureExtractorWritesThem) {
  for (const std::string model :
       {"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"}) {
    EXPECT_TRUE(LooksLikeExif(ExifCamera(model))) << model;
  }
  // Without its projection, a fisheye lens has no geometry at all.
  EXPECT_FALSE(LooksLikeExif(ExifCamera("OPENCV_FISHEYE")));
  colmap::Camera camera = ExifCamera("SIMPLE_RADIAL");
  camera.SetPriorFocalLength(false);
  EXPECT_FALSE(LooksLikeExif(camera));
}

TEST(LooksLikeExif, NotOnceAnythingElseIsGiven) {
  // Each parameter of an OPENCV camera, by little; both focal lengths together
  // would be another EXIF focal length.
  for (size_t idx = 0; idx < 8; ++idx) {
    colmap::Camera camera = ExifCamera("OPENCV");
    camera.Params(idx) += 1e-6;
    EXPECT_FALSE(LooksLikeExif(camera)) << "parameter " << idx;
  }
}

Scene SceneOf(const colmap::Camera& camera) {
  Scene scene;
  scene.cameras.emplace(1, camera);
  return scene;
}

TEST(SortPriors, TurnsExifIntoSoftPriors) {
  colmap::Camera calibrated = ExifCamera("SIMPLE_RADIAL");
  calibrated.Params(3) = 0.02;
  struct Case {
    PriorTrust trust;
    colmap::Camera camera;
    bool is_soft;
  };
  const colmap::Camera exif = ExifCamera("SIMPLE_RADIAL");
  for (const Case& c : {Case{PriorTrust::AUTO, exif, true},
                        Case{PriorTrust::AUTO, calibrated, false},
                        Case{PriorTrust::EXIF, calibrated, true},
                        Case{PriorTrust::CALIBRATED, exif, false}}) {
    Scene scene = SceneOf(c.camera);
    SortPriors(c.trust, &scene);
    EXPECT_EQ(scene.cameras.at(1).HasPriorFocalLength(), !c.is_soft);
    EXPECT_EQ(scene.focal_priors.count(1), c.is_soft ? 1 : 0);
    EXPECT_EQ(FocalPriorOf(scene, 1).focal_px, c.is_soft ? 700 : 0);
  }
}

TEST(FocalPriorOf, DatabaseGoesBeforeImageFiles) {
  colmap::Camera camera = ExifCamera("SIMPLE_RADIAL");
  Scene scene = SceneOf(camera);
  scene.exif[1] = {"make|model", 1.0};
  // The diagonal of the image.
  EXPECT_NEAR(FocalPriorOf(scene, 1).focal_px, std::hypot(641, 480), 1e-9);
  SortPriors(PriorTrust::AUTO, &scene);
  EXPECT_EQ(FocalPriorOf(scene, 1).focal_px, 700);
}

TEST(PriorTrustFromName, RefusesOtherNames) {
  EXPECT_EQ(PriorTrustFromName("exif"), PriorTrust::EXIF);
  EXPECT_FALSE(PriorTrustFromName("EXIF"));
  EXPECT_FALSE(PriorTrustFromName(""));
}

}  // namespace
}  // namespace dgsfm
