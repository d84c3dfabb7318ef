#include "colmap_ext/synthetic/ray_caster.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_camera.h"
#include "colmap_ext/synthetic/town_scene.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

Texture Plain() {
  return [](const Eigen::Vector2d&, double) {
    return Eigen::Vector3f(0.5, 0.5, 0.5);
  };
}

colmap::Camera CreateCamera(int width, int height) {
  SyntheticCameraOptions options;
  options.width_px = width;
  options.height_px = height;
  options.focal_length_px = width;
  options.radial_distortion = -0.1;
  return SynthesizeCameras(options, 1, 0).at(1);
}

TEST(RayCaster, DepthIsTheAnalyticIntersection) {
  // A ground, a box with its front at y = 8 and a ball before it.
  RenderScene scene;
  scene.solids.push_back(CreateGround(Plain()));
  scene.solids.push_back(CreateBox({0, 10, 0}, {6, 4, 3}, 0, Plain(), Plain()));
  scene.spheres.push_back({{1, 6, 1}, 0.5, Plain()});
  const Eigen::Vector3d center(0, -2, 1.5);
  const Rigid3d cam_from_world = LookAt(center, {0, 8, 1});
  const colmap::Camera camera = CreateCamera(80, 60);
  const RenderedImage image = RenderImage(scene, camera, cam_from_world, 1);
  int num_sky = 0, num_ground = 0, num_front = 0, num_ball = 0;
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 80; ++x) {
      const double depth = image.depth_map.At(x, y);
      if (depth == 0) {
        ++num_sky;
        continue;
      }
      const Eigen::Vector3d in_cam =
          depth * camera.ImageToWorld({x + 0.5, y + 0.5}).homogeneous();
      const Eigen::Vector3d point = cam_from_world.Inverse() * in_cam;
      // Depth is a float: 1e-6 of 10 m; the horizon is excluded.
      if (depth > 100) continue;
      const double tolerance = 1e-6 * depth;
      const bool on_front = std::abs(point.y() - 8) < tolerance;
      const bool on_ground = std::abs(point.z()) < tolerance;
      const bool on_ball =
          std::abs((point - Eigen::Vector3d(1, 6, 1)).norm() - 0.5) < 1e-5;
      EXPECT_EQ(on_front + on_ground + on_ball, 1) << point.transpose();
      num_front += on_front;
      num_ground += on_ground;
      num_ball += on_ball;
    }
  }
  EXPECT_GT(num_sky, 100);
  EXPECT_GT(num_ground, 100);
  EXPECT_GT(num_front, 100);
  EXPECT_GT(num_ball, 10);
}

TEST(RayCaster, RoofsAndFrustumsAreClosed) {
  const Eigen::Vector3d base(1, 2, 3);
  const ConvexSolid solids[] = {
      CreateBox(base, {2, 3, 1}, 0.3, Plain(), Plain()),
      CreateGableRoof(base, {2, 3, 1}, 0.3, Plain(), Plain()),
      CreateFrustum(base, 1, 0, 1, 8, Plain(), Plain()),
      CreateFrustum(base, 0.5, 1, 1, 8, Plain(), Plain())};
  const Eigen::Vector3d inside = base + Eigen::Vector3d(0, 0, 0.4);
  for (const ConvexSolid& solid : solids) {
    for (const Face& face : solid.faces) {
      EXPECT_NEAR(face.normal.norm(), 1, 1e-12);
      EXPECT_LT(face.normal.dot(inside), face.offset);
      EXPECT_NEAR(face.normal.dot(face.origin), face.offset, 1e-12);
    }
    RenderScene scene;
    scene.solids.push_back(solid);
    for (int i = 0; i < 100; ++i) {
      const double azimuth = 0.1 * i;
      const Eigen::Vector3d direction(
          std::cos(azimuth), std::sin(azimuth), std::sin(1.7 * i));
      const auto t = CastRay(scene, inside - 10 * direction, direction);
      ASSERT_TRUE(t.has_value());
      // The surface is met before the inner point, within the bound.
      EXPECT_LT(*t, 10);
      const Eigen::Vector3d point = inside + (*t - 10) * direction;
      EXPECT_LT((point - solid.center).norm(), solid.radius + 1e-9);
    }
  }
}

TEST(RayCaster, ImagesAreTheSameForAnyNumberOfThreads) {
  const RenderScene town = CreateTown(0);
  const colmap::Camera camera = CreateCamera(160, 120);
  const Rigid3d view = CreateTownViews(SceneFamily::RING, 24, 0)[0];
  const RenderedImage image1 = RenderImage(town, camera, view, 1);
  const RenderedImage image2 = RenderImage(CreateTown(0), camera, view, 3);
  EXPECT_EQ(image1.bitmap.ConvertToRowMajorArray(),
            image2.bitmap.ConvertToRowMajorArray());
  EXPECT_EQ(image1.depth_map.values, image2.depth_map.values);
}

TEST(TownScene, SurfacePointsAreConsistentWithDepthAndColorOfTheirImages) {
  const RenderScene town = CreateTown(0);
  colmap::Reconstruction model;
  model.AddCamera(CreateCamera(320, 240));
  const std::vector<Rigid3d> views = CreateTownViews(SceneFamily::RING, 24, 0);
  std::vector<RenderedImage> rendered;
  for (int i = 0; i < 3; ++i) {
    colmap::Image image;
    image.SetImageId(i + 1);
    image.SetCameraId(1);
    SetCamFromWorld(views[i], &image);
    model.AddImage(image);
    model.RegisterImage(i + 1);
    rendered.push_back(RenderImage(town, model.Camera(1), views[i], 2));
  }
  AddSurfacePoints(town, 400, &model);
  EXPECT_GT(model.NumPoints3D(), 400);
  int num_observations = 0, num_depths = 0, num_pairs = 0, num_colors = 0;
  for (const auto& [point3D_id, point3D] : model.Points3D()) {
    std::vector<colmap::BitmapColor<float>> colors;
    for (const colmap::TrackElement& element : point3D.Track().Elements()) {
      const colmap::Image& image = model.Image(element.image_id);
      const Eigen::Vector3d in_cam = CamFromWorld(image) * point3D.XYZ();
      const Eigen::Vector2d xy = image.Point2D(element.point2D_idx).XY();
      const Eigen::Vector2d projected =
          model.Camera(1).WorldToImage(in_cam.hnormalized());
      // Double precision at 1e2 px.
      EXPECT_LT((projected - xy).norm(), 1e-9);
      const RenderedImage& view = rendered[element.image_id - 1];
      const double depth = view.depth_map.At(std::min(319, int(xy.x())),
                                             std::min(239, int(xy.y())));
      ++num_observations;
      num_depths += std::abs(depth / in_cam.z() - 1) < 0.05;
      colmap::BitmapColor<float> color;
      if (view.bitmap.InterpolateBilinear(xy.x() - 0.5, xy.y() - 0.5, &color)) {
        colors.push_back(color);
      }
    }
    for (size_t i = 1; i < colors.size(); ++i) {
      ++num_pairs;
      num_colors += std::abs(colors[i].g - colors[0].g) < 30;
    }
  }
  // Points at depth edges may fall on the other side of their pixel, those at
  // the edges of textures differ by what a pixel averages.
  EXPECT_GT(num_depths, 0.93 * num_observations);
  EXPECT_GT(num_colors, 0.85 * num_pairs);
}

}  // namespace
}  // namespace dgsfm
