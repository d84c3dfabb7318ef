#include "sfm/intrinsics/calibration_check.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

CameraMap OneCamera(double principal_x_px, double principal_y_px) {
  CameraMap cameras;
  cameras[3].InitializeWithName("PINHOLE", 1000, 1600, 1200);
  cameras[3].SetPrincipalPointX(principal_x_px);
  cameras[3].SetPrincipalPointY(principal_y_px);
  return cameras;
}

TEST(PrincipalPointAdvice, NoneForImagesAndCrops) {
  EXPECT_THAT(PrincipalPointAdvice(OneCamera(800, 600)), IsEmpty());
  EXPECT_THAT(PrincipalPointAdvice(OneCamera(850, 560)), IsEmpty());
  // The left half of a larger image.
  EXPECT_THAT(PrincipalPointAdvice(OneCamera(1600, 600)), IsEmpty());
}

TEST(PrincipalPointAdvice, NamesExchangedCoordinates) {
  EXPECT_THAT(PrincipalPointAdvice(OneCamera(605, 790)),
              ElementsAre(HasSubstr("camera 3 seems to have its coordinates "
                                    "exchanged")));
}

TEST(PrincipalPointAdvice, NamesTheOtherSize) {
  EXPECT_THAT(PrincipalPointAdvice(OneCamera(400, 300)),
              ElementsAre(HasSubstr("images 0.5 times as large as the "
                                    "1600 x 1200")));
  EXPECT_THAT(PrincipalPointAdvice(OneCamera(1600, 1190)),
              ElementsAre(HasSubstr("images 2 times as large")));
}

TEST(CalibratedFocalAdvice, ComparesWithTheGivenFocalLength) {
  SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::RING);
  options.num_images = 3;
  options.camera.num_cameras = 1;
  options.camera.focal_length_px = 700;
  const colmap::Reconstruction model =
      ReconstructionFromSynthetic(SynthesizeScene(options));
  const colmap::camera_t camera_id = model.Cameras().begin()->first;
  CameraMap given;
  given[camera_id] = model.Camera(camera_id);
  const auto advice = [&](double focal_length_px, bool is_calibrated) {
    given[camera_id].SetFocalLength(focal_length_px);
    given[camera_id].SetPriorFocalLength(is_calibrated);
    return CalibratedFocalAdvice(0.01, given, model);
  };
  EXPECT_FALSE(advice(680, true));
  EXPECT_FALSE(advice(600, false));
  const auto contradicted = advice(600, true);
  ASSERT_TRUE(contradicted);
  EXPECT_THAT(*contradicted,
              HasSubstr("600 px were given, the model has 700 px"));
}

}  // namespace
}  // namespace dgsfm
