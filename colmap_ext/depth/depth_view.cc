#include "colmap_ext/depth/depth_view.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>

namespace dgsfm {
namespace {

// Depths of neighbouring pixels within this factor are of one surface.
constexpr float kMaxSurfaceRatio = 1.1f;
// Half the side of the window of a tangent plane [samples], and samples along
// the longer side of the map, so that it is a fiftieth of that.
constexpr int kWindowRadius = 3;
constexpr int kNumSamplesPerSide = 400;
// Pixels between stored rays: a distortion of 0.1 bends rays by less than a
// hundredth of a pixel over that.
constexpr int kRayStep = 8;

}  // namespace

DepthView::DepthView(const colmap::Camera& camera,
                     const Rigid3d& cam_from_world,
                     DepthMap map,
                     double stddev)
    : camera_(camera),
      cam_from_world_(cam_from_world),
      map_(std::move(map)),
      stddev_(stddev) {
  DGSFM_CHECK(stddev > 0) << "stddev = " << stddev;
  const Eigen::Array2d scale(double(camera.Width()) / map_.width,
                             double(camera.Height()) / map_.height);
  num_ray_cols_ = map_.width / kRayStep + 2;
  const int num_rows = map_.height / kRayStep + 2;
  for (int row = 0; row < num_rows; ++row) {
    for (int col = 0; col < num_ray_cols_; ++col) {
      const Eigen::Array2d pixel(col * kRayStep + 0.5, row * kRayStep + 0.5);
      rays_.push_back(camera.ImageToWorld((pixel * scale).matrix()));
    }
  }
}

Eigen::Vector3d DepthView::Ray(int x, int y) const {
  const size_t i = size_t(y / kRayStep) * num_ray_cols_ + x / kRayStep;
  const double a = double(x % kRayStep) / kRayStep;
  const double b = double(y % kRayStep) / kRayStep;
  const Eigen::Vector2d ray =
      (1 - b) * ((1 - a) * rays_[i] + a * rays_[i + 1]) +
      b * ((1 - a) * rays_[i + num_ray_cols_] +
           a * rays_[i + num_ray_cols_ + 1]);
  return {ray.x(), ray.y(), 1};
}

Eigen::Vector2d DepthView::Project(const Eigen::Vector3d& xyz) const {
  const Eigen::Vector2d xy = camera_.WorldToImage(xyz.hnormalized());
  return {xy.x() * map_.width / camera_.Width(),
          xy.y() * map_.height / camera_.Height()};
}

bool DepthView::Covers(const Eigen::Vector2d& place) const {
  return place.x() >= 0 && place.y() >= 0 && place.x() < map_.width &&
         place.y() < map_.height;
}

double DepthView::InverseDepthAt(const Eigen::Vector2d& place) const {
  if (!Covers(place)) return 0;
  const double x = std::clamp(place.x() - 0.5, 0.0, map_.width - 1.0);
  const double y = std::clamp(place.y() - 0.5, 0.0, map_.height - 1.0);
  const int left = static_cast<int>(x);
  const int top = static_cast<int>(y);
  const int right = std::min(left + 1, map_.width - 1);
  const int bottom = std::min(top + 1, map_.height - 1);
  const std::array<float, 4> depths = {map_.At(left, top),
                                       map_.At(right, top),
                                       map_.At(left, bottom),
                                       map_.At(right, bottom)};
  const auto [min, max] = std::minmax_element(depths.begin(), depths.end());
  if (*min <= 0 || *max > kMaxSurfaceRatio * *min) return 0;
  const double a = x - left;
  const double b = y - top;
  return (1 - b) * ((1 - a) / depths[0] + a / depths[1]) +
         b * ((1 - a) / depths[2] + a / depths[3]);
}

Eigen::Vector3d DepthView::TangentPlane(int x, int y) const {
  const int step = std::max(
      1,
      static_cast<int>(std::round(double(std::max(map_.width, map_.height)) /
                                  kNumSamplesPerSide)));
  const float depth = map_.At(x, y);
  const Eigen::Vector3d center = Ray(x, y);
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
  int num_of_surface = 0;
  constexpr int kNumSamples = (2 * kWindowRadius + 1) * (2 * kWindowRadius + 1);
  for (int row = -kWindowRadius; row <= kWindowRadius; ++row) {
    const int v = y + row * step;
    if (v < 0 || v >= map_.height) continue;
    for (int col = -kWindowRadius; col <= kWindowRadius; ++col) {
      const int u = x + col * step;
      if (u < 0 || u >= map_.width) continue;
      const float other = map_.At(u, v);
      if (other * kMaxSurfaceRatio < depth ||
          other > depth * kMaxSurfaceRatio) {
        continue;
      }
      ++num_of_surface;
      // Around the pixel, where the numbers are of one size.
      Eigen::Vector3d ray = Ray(u, v) - center;
      ray.z() = 1;
      hessian.noalias() += ray * ray.transpose();
      rhs += ray / other;
    }
  }
  if (2 * num_of_surface <= kNumSamples) return Eigen::Vector3d::Zero();
  // More than half of a window of several rows and columns is on no line.
  Eigen::Vector3d plane = hessian.ldlt().solve(rhs);
  plane.z() -= plane.head<2>().dot(center.head<2>());
  return plane.allFinite() ? plane : Eigen::Vector3d::Zero();
}

float DepthView::LeastDepthAround(int x, int y) const {
  float least = std::numeric_limits<float>::max();
  for (int v = std::max(y - 1, 0); v <= std::min(y + 1, map_.height - 1); ++v) {
    for (int u = std::max(x - 1, 0); u <= std::min(x + 1, map_.width - 1);
         ++u) {
      least = std::min(least, map_.At(u, v));
    }
  }
  return least;
}

bool DepthView::IsAtEdge(int x, int y) const {
  return LeastDepthAround(x, y) * kMaxSurfaceRatio < map_.At(x, y);
}

}  // namespace dgsfm
