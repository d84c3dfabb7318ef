// Renders solids of flat faces and spheres with procedural textures, the sun
// and its shadows: images and exact depth maps for scenes of tens of solids.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/rigid3.h"
#include "colmap_ext/synthetic/procedural_texture.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>
#include <colmap/util/bitmap.h>

#include <limits>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// One face of a convex solid; inside is normal.dot(x) <= offset.
struct Face {
  Eigen::Vector3d normal;  // unit, outwards
  double offset = 0;       // [m]
  // Texture coordinates of x are (u_axis, v_axis).dot(x - origin) [m].
  Eigen::Vector3d origin;
  Eigen::Vector3d u_axis;
  Eigen::Vector3d v_axis;
  Texture texture;
};

// Intersection of half-spaces; one face makes an infinite ground.
struct ConvexSolid {
  std::vector<Face> faces;
  // Bounding sphere [m].
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = std::numeric_limits<double>::infinity();
};

// Texture coordinates are longitude and latitude times the radius [m].
struct Sphere {
  Eigen::Vector3d center;
  double radius = 1;  // [m]
  Texture texture;
};

struct RenderScene {
  std::vector<ConvexSolid> solids;
  std::vector<Sphere> spheres;
  Eigen::Vector3d direction_to_sun = Eigen::Vector3d(0.4, -0.7, 0.9);
};

// `base` is the centre of the lower side, `yaw_rad` turns around the vertical;
// the textures of faces start at their lower left corner, seen from outside,
// those of a frustum's top in its middle.
ConvexSolid CreateBox(const Eigen::Vector3d& base,
                      const Eigen::Vector3d& size,
                      double yaw_rad,
                      const Texture& side,
                      const Texture& top);
// A roof with its ridge along the x axis of the house, `size` as for a box.
ConvexSolid CreateGableRoof(const Eigen::Vector3d& base,
                            const Eigen::Vector3d& size,
                            double yaw_rad,
                            const Texture& roof,
                            const Texture& gable);
// A regular prism, or a frustum if the radii differ (top radius 0: pyramid).
ConvexSolid CreateFrustum(const Eigen::Vector3d& base,
                          double radius,
                          double top_radius,
                          double height,
                          int num_sides,
                          const Texture& side,
                          const Texture& top);
ConvexSolid CreateGround(const Texture& texture);

struct RenderedImage {
  colmap::Bitmap bitmap;
  // Exact z-depth [m] along the ray of each pixel's centre; 0 for the sky.
  DepthMap depth_map;
};

// Four rays per pixel for colour, one for depth; distortion of the camera is
// exact. Lambertian: a point has the same colour in all images, up to the
// averaging over pixels. Deterministic for any number of threads.
RenderedImage RenderImage(const RenderScene& scene,
                          const colmap::Camera& camera,
                          const Rigid3d& cam_from_world,
                          int num_threads);

// Smallest t > 0 at which origin + t * direction meets a surface.
std::optional<double> CastRay(const RenderScene& scene,
                              const Eigen::Vector3d& origin,
                              const Eigen::Vector3d& direction);

}  // namespace dgsfm
