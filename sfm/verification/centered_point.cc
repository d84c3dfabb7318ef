#include "sfm/verification/centered_point.h"

#include "estimators/optimization/camera_projection.h"

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
  Eigen::Vector2d projected_px;
  ProjectionJacobian by;
  // Written so that NaN fails.
  if (!(ray.norm() <= kMaxRayTangent) ||
      !ProjectionOfModel(camera.ModelId())(
          camera.ParamsData(), ray.homogeneous(), &projected_px, &by) ||
      !((projected_px - xy_px).norm() <= kMaxUndistortionErrorPx)) {
    return std::nullopt;
  }
  CenteredPoint centered;
  centered.point = focal_length_px * ray;
  centered.pixel_jacobian = by.point.leftCols<2>() / focal_length_px;
  return centered;
}

}  // namespace dgsfm
