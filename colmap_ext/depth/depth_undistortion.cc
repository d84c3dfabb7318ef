#include "colmap_ext/depth/depth_undistortion.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// The undistorted map keeps the density of the original.
int ScaledSize(int size, size_t from, size_t to) {
  const double scaled = std::round(double(size) * to / from);
  return static_cast<int>(std::clamp(scaled, 1.0, double(kMaxDepthMapSize)));
}

}  // namespace

DepthMap UndistortDepth(const DepthMap& depth_map,
                        const colmap::Camera& camera,
                        const colmap::Camera& undistorted_camera) {
  DepthMap undistorted;
  undistorted.unit = depth_map.unit;
  undistorted.width =
      ScaledSize(depth_map.width, camera.Width(), undistorted_camera.Width());
  undistorted.height = ScaledSize(
      depth_map.height, camera.Height(), undistorted_camera.Height());
  const double x_scale = double(undistorted_camera.Width()) / undistorted.width;
  const double y_scale =
      double(undistorted_camera.Height()) / undistorted.height;
  std::vector<Eigen::Vector2d> row(undistorted.width, Eigen::Vector2d::Zero());
  for (int y = 0; y < undistorted.height; ++y) {
    for (int x = 0; x < undistorted.width; ++x) {
      const Eigen::Vector2d ray = undistorted_camera.ImageToWorld(
          {(x + 0.5) * x_scale, (y + 0.5) * y_scale});
      row[x] = camera.WorldToImage(ray);
    }
    // z-depth is the same in both cameras, which share centre and axes: only
    // its place in the image changes.
    const std::vector<float> depths =
        SampleDepth(depth_map,
                    row,
                    static_cast<int>(camera.Width()),
                    static_cast<int>(camera.Height()),
                    {});
    undistorted.values.insert(
        undistorted.values.end(), depths.begin(), depths.end());
  }
  return undistorted;
}

}  // namespace dgsfm
