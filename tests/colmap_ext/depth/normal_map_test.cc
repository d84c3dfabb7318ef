#include "colmap_ext/depth/normal_map.h"

#include <cmath>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kWidth = 64;
constexpr int kHeight = 48;

// Ten times the size of the maps.
colmap::Camera CreateCamera(const std::string& model_name) {
  colmap::Camera camera;
  camera.InitializeWithName(model_name, 500, 10 * kWidth, 10 * kHeight);
  return camera;
}

// Depth of the plane normal * X = -3, in steps as of half precision.
DepthMap CreatePlane(const Eigen::Vector3d& normal) {
  const colmap::Camera camera = CreateCamera("SIMPLE_PINHOLE");
  DepthMap map = {kWidth, kHeight, DepthUnit::METRIC, {}};
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const Eigen::Vector2d ray = camera.ImageToWorld({10 * x + 5, 10 * y + 5});
      const double depth = -3 / normal.dot(ray.homogeneous());
      map.values.push_back(static_cast<float>(std::round(depth * 1024) / 1024));
    }
  }
  return map;
}

TEST(NormalMap, IsThatOfThePlane) {
  const Eigen::Vector3d normal = Eigen::Vector3d(0.3, -0.5, -1).normalized();
  const std::vector<Eigen::Vector3f> normals =
      ComputeNormals(CreatePlane(normal), CreateCamera("SIMPLE_PINHOLE"));
  ASSERT_EQ(normals.size(), kWidth * kHeight);
  for (const Eigen::Vector3f& found : normals) {
    EXPECT_NEAR(found.norm(), 1, 1e-6);
    EXPECT_GT(found.cast<double>().dot(normal), std::cos(0.01));
  }
}

TEST(NormalMap, SurfacesDoNotMix) {
  const Eigen::Vector3d normal = Eigen::Vector3d(0.2, 0, -1).normalized();
  DepthMap map = CreatePlane(normal);
  const DepthMap other = CreatePlane({0, 0, -1});
  for (int y = 0; y < kHeight; ++y) {
    for (int x = kWidth / 2; x < kWidth; ++x) {
      const int i = y * kWidth + x;
      map.values[i] = 5 * other.values[i];
    }
  }
  map.values[0] = 0;
  // One pixel in front of all others.
  map.values[20 * kWidth + 10] = 1;
  const std::vector<Eigen::Vector3f> normals =
      ComputeNormals(map, CreateCamera("PINHOLE"));
  EXPECT_TRUE(normals[0].isZero());
  EXPECT_TRUE(normals[20 * kWidth + 10].isZero());
  const auto at = [&](int x) {
    return Eigen::Vector3d(normals[10 * kWidth + x].cast<double>());
  };
  EXPECT_GT(at(kWidth / 2 - 1).dot(normal), std::cos(0.02));
  EXPECT_LT(at(kWidth / 2).z(), -std::cos(0.02));
}

TEST(NormalMap, RefusesDistortion) {
  colmap::Camera camera = CreateCamera("SIMPLE_RADIAL");
  camera.SetParams({500, 320, 240, 0.1});
  EXPECT_THROW(ComputeNormals(CreatePlane({0, 0, -1}), camera),
               std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
