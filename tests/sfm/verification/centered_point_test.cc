#include "sfm/verification/centered_point.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

colmap::Camera CreateCamera(const std::string& model,
                            const std::vector<double>& params) {
  colmap::Camera camera;
  camera.SetModelIdFromName(model);
  camera.SetWidth(1000);
  camera.SetHeight(800);
  camera.SetParams(params);
  return camera;
}

TEST(UndistortPoint, IsTheOffsetFromThePrincipalPointOfAPinhole) {
  const colmap::Camera camera = CreateCamera("SIMPLE_PINHOLE", {900, 480, 410});
  const auto point = UndistortPoint(camera, {500, 400});
  ASSERT_TRUE(point);
  EXPECT_LT((point->point - Eigen::Vector2d(20, -10)).norm(), 1e-9);
  EXPECT_LT((point->pixel_jacobian - Eigen::Matrix2d::Identity()).norm(), 1e-9);
}

TEST(UndistortPoint, UsesTheMeanFocalLength) {
  const colmap::Camera camera = CreateCamera("PINHOLE", {900, 1000, 500, 400});
  const auto point = UndistortPoint(camera, {590, 500});
  ASSERT_TRUE(point);
  EXPECT_LT((point->point - Eigen::Vector2d(95, 95)).norm(), 1e-9);
}

TEST(UndistortPoint, JacobianTurnsErrorsIntoPixels) {
  const colmap::Camera camera =
      CreateCamera("OPENCV", {900, 900, 500, 400, -0.2, 0.05, 1e-3, -1e-3});
  const Eigen::Vector2d pixel(750, 620);
  const auto point = UndistortPoint(camera, pixel);
  ASSERT_TRUE(point);
  const Eigen::Vector2d step(0.3, -0.2);
  const Eigen::Vector2d moved =
      camera.WorldToImage((point->point + step) / 900);
  // Second order in the step.
  EXPECT_LT((moved - pixel - point->pixel_jacobian * step).norm(), 1e-3);
}

TEST(UndistortPoint, JacobianIsFiniteAtThePrincipalPoint) {
  for (const std::string model : {"SIMPLE_RADIAL",
                                  "OPENCV",
                                  "FULL_OPENCV",
                                  "OPENCV_FISHEYE",
                                  "FOV",
                                  "SIMPLE_RADIAL_FISHEYE",
                                  "RADIAL_FISHEYE",
                                  "THIN_PRISM_FISHEYE"}) {
    colmap::Camera camera;
    camera.InitializeWithName(model, 900, 1000, 800);
    const auto point = UndistortPoint(camera, {500, 400});
    ASSERT_TRUE(point) << model;
    EXPECT_TRUE(
        point->pixel_jacobian.isApprox(Eigen::Matrix2d::Identity(), 1e-4))
        << model << ": " << point->pixel_jacobian;
  }
}

TEST(UndistortPoint, HasNothingBeyond84Degrees) {
  // Equidistant: the angle is the distance over the focal length.
  const colmap::Camera camera =
      CreateCamera("SIMPLE_RADIAL_FISHEYE", {300, 500, 400, 0});
  const double limit = 84 * M_PI / 180 * 300;
  EXPECT_TRUE(UndistortPoint(camera, {500 + limit - 2, 400}));
  EXPECT_FALSE(UndistortPoint(camera, {500 + limit + 2, 400}));
}

}  // namespace
}  // namespace dgsfm
