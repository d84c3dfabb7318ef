#include "sfm/intrinsics/camera_model_check.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// The true model of a ring, with key points moved along the radius by this
// share of their distance from the image centre, cubed and per 400 px.
RadialErrors ErrorsOf(double focal_length_px, double cubic_error_px) {
  SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::INTERNET);
  options.num_images = 12;
  options.num_points_per_image = 300;
  options.image_noise_px = 0.5;
  options.camera = {};
  options.camera.num_cameras = 1;
  options.camera.focal_length_px = focal_length_px;
  colmap::Reconstruction model =
      ReconstructionFromSynthetic(SynthesizeScene(options));
  for (const colmap::image_t image_id : model.RegImageIds()) {
    colmap::Image& image = model.Image(image_id);
    for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
      colmap::Point2D& point2D = image.Point2D(i);
      const Eigen::Vector2d offset = point2D.XY() - Eigen::Vector2d(400, 300);
      const double share = offset.squaredNorm() / (400 * 400);
      point2D.SetXY(point2D.XY() + cubic_error_px * share * offset / 400);
    }
  }
  return MeasureRadialErrors(model);
}

TEST(CameraModelAdvice, NoneForNoise) {
  const RadialErrors errors = ErrorsOf(700, 0);
  // Rings of a hundred observations and 0.5 px of noise: three times 0.05 px.
  EXPECT_LT(errors.max_mean_px, 0.15);
  EXPECT_NEAR(errors.focal_ratio, 700.0 / 800, 1e-9);
  EXPECT_EQ(errors.center_offset_ratio, 0);
  EXPECT_FALSE(CameraModelAdvice(errors));
}

TEST(CameraModelAdvice, ErrorsAlongTheRadiusAskForAnotherModel) {
  const RadialErrors errors = ErrorsOf(700, 2);
  EXPECT_GT(errors.max_mean_px, 1);
  const auto advice = CameraModelAdvice(errors);
  ASSERT_TRUE(advice);
  EXPECT_NE(advice->find("RADIAL"), std::string::npos);
  EXPECT_EQ(advice->find("FISHEYE"), std::string::npos);
}

TEST(CameraModelAdvice, WideAnglesMayBeFisheyeLenses) {
  RadialErrors errors;
  errors.focal_ratio = 0.4;
  EXPECT_FALSE(CameraModelAdvice(errors));
  errors.max_mean_px = 0.3;
  ASSERT_TRUE(CameraModelAdvice(errors));
  EXPECT_NE(CameraModelAdvice(errors)->find("FISHEYE"), std::string::npos);
  errors.max_mean_px = 0;
  errors.center_offset_ratio = 0.2;
  EXPECT_TRUE(CameraModelAdvice(errors));
}

}  // namespace
}  // namespace dgsfm
