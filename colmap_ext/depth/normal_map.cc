#include "colmap_ext/depth/normal_map.h"

#include "colmap_ext/check.h"

#include <algorithm>

#include <Eigen/Cholesky>

namespace dgsfm {
namespace {

// Half the side of the window [px]: the steps of half precision turn a normal
// by less than a degree.
constexpr int kWindowRadius = 3;
// Depths within this factor of that of the pixel are of its surface.
constexpr float kMaxDepthRatio = 1.1f;

// Inverse depth at the pixel and its slopes [per px]; zero if too few pixels of
// the window are of the surface.
Eigen::Vector3d FitInverseDepth(const DepthMap& map, int x, int y) {
  const float depth = map.At(x, y);
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
  int num_pixels = 0;
  int num_of_surface = 0;
  for (int v = std::max(y - kWindowRadius, 0);
       v <= std::min(y + kWindowRadius, map.height - 1);
       ++v) {
    for (int u = std::max(x - kWindowRadius, 0);
         u <= std::min(x + kWindowRadius, map.width - 1);
         ++u) {
      ++num_pixels;
      const float other = map.At(u, v);
      if (other * kMaxDepthRatio < depth || other > depth * kMaxDepthRatio) {
        continue;
      }
      ++num_of_surface;
      const Eigen::Vector3d row(u - x, v - y, 1);
      hessian += row * row.transpose();
      rhs += row / other;
    }
  }
  if (2 * num_of_surface <= num_pixels) return Eigen::Vector3d::Zero();
  // More than half of a window of several rows and columns is on no line.
  const Eigen::Vector3d fit = hessian.ldlt().solve(rhs);
  return fit.allFinite() ? fit : Eigen::Vector3d::Zero();
}

}  // namespace

std::vector<Eigen::Vector3f> ComputeNormals(const DepthMap& depth_map,
                                            const colmap::Camera& camera) {
  DGSFM_CHECK(camera.IsUndistorted()) << camera.ModelName();
  const double x_scale = double(camera.Width()) / depth_map.width;
  const double y_scale = double(camera.Height()) / depth_map.height;
  // Coordinates of rays per pixel of the map.
  const Eigen::Array2d step =
      (camera.ImageToWorld({x_scale, y_scale}) - camera.ImageToWorld({0, 0}))
          .array();
  std::vector<Eigen::Vector3f> normals;
  normals.reserve(depth_map.values.size());
  for (int y = 0; y < depth_map.height; ++y) {
    for (int x = 0; x < depth_map.width; ++x) {
      normals.push_back(Eigen::Vector3f::Zero());
      if (depth_map.At(x, y) <= 0) continue;
      const Eigen::Vector3d fit = FitInverseDepth(depth_map, x, y);
      if (fit.z() <= 0) continue;
      // Points X of the plane n X = 1 have the inverse depth n X / z.
      const Eigen::Vector2d ray =
          camera.ImageToWorld({(x + 0.5) * x_scale, (y + 0.5) * y_scale});
      Eigen::Vector3d n;
      n.head<2>() = fit.head<2>().array() / step;
      n.z() = fit.z() - n.head<2>().dot(ray);
      normals.back() = -n.normalized().cast<float>();
    }
  }
  return normals;
}

}  // namespace dgsfm
