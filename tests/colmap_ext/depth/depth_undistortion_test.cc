#include "colmap_ext/depth/depth_undistortion.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

colmap::Camera CreateCamera(const std::string& model,
                            size_t width,
                            size_t height,
                            const std::vector<double>& params) {
  colmap::Camera camera;
  camera.SetModelIdFromName(model);
  camera.SetWidth(width);
  camera.SetHeight(height);
  camera.SetParams(params);
  return camera;
}

// A plane across the camera: inverse depth is linear in the ray.
double PlaneDepth(const Eigen::Vector2d& ray) {
  return 1 / (0.3 + 0.1 * ray.x() - 0.05 * ray.y());
}

TEST(UndistortDepth, KeepsThePlane) {
  const colmap::Camera camera =
      CreateCamera("SIMPLE_RADIAL", 640, 480, {500, 320, 240, -0.15});
  // A quarter wider: its border is beyond the image.
  const colmap::Camera pinhole =
      CreateCamera("PINHOLE", 800, 480, {500, 500, 400, 240});
  DepthMap map = {320, 240, DepthUnit::RELATIVE, {}};
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      map.values.push_back(static_cast<float>(
          PlaneDepth(camera.ImageToWorld({2 * x + 1.0, 2 * y + 1.0}))));
    }
  }
  const DepthMap undistorted = UndistortDepth(map, camera, pinhole);
  ASSERT_EQ(undistorted.width, 400);
  ASSERT_EQ(undistorted.height, 240);
  EXPECT_EQ(undistorted.unit, DepthUnit::RELATIVE);
  EXPECT_EQ(undistorted.At(0, 120), 0);
  EXPECT_EQ(undistorted.At(399, 120), 0);
  for (int y = 20; y < 220; ++y) {
    for (int x = 60; x < 340; ++x) {
      const double expected =
          PlaneDepth(pinhole.ImageToWorld({2 * x + 1.0, 2 * y + 1.0}));
      // Interpolation between pixels; without moving them it is off by up to 2
      // %.
      EXPECT_NEAR(undistorted.At(x, y) / expected, 1, 1e-4);
    }
  }
}

}  // namespace
}  // namespace dgsfm
