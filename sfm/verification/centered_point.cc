#include "sfm/verification/centered_point.h"

namespace dgsfm {

namespace {

constexpr double kMaxRayTangent = 10;
// Up to this the iterative undistortion has converged [px].
constexpr double kMaxUndistortionErrorPx = 0.1;

}  // namespace

std::optional<CenteredPoint> UndistortPoint(const colmap::Camera& camera,
                                            const Eigen::Vector2d& xy_px) {
  const double focal_length_px = camera.MeanFocalLength();
  const Eigen::Vector2d ray = camera.ImageToWorld(xy_px);
  // Written so that NaN fails.
  if (!(ray.norm() <= kMaxRayTangent) ||
      !((camera.WorldToImage(ray) - xy_px).norm() <= kMaxUndistortionErrorPx)) {
    return std::nullopt;
  }
  CenteredPoint centered;
  centered.point = focal_length_px * ray;
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(k);
    centered.pixel_jacobian.col(k) =
        (camera.WorldToImage(ray + step) - camera.WorldToImage(ray - step)) /
        (2 * kStep * focal_length_px);
  }
  return centered;
}

}  // namespace dgsfm
