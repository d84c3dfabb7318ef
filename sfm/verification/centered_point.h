// Image points without distortion, for estimators without camera models.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

#include <optional>

#include <Eigen/Core>

namespace dgsfm {

struct CenteredPoint {
  // Relative to the principal point [px].
  Eigen::Vector2d point;
  // Derivative of the pixel in the image by the point [1], which turns errors
  // of the point into pixels of the image.
  Eigen::Matrix2d pixel_jacobian = Eigen::Matrix2d::Identity();
};

// Point f (X, Y) / Z of the ray (X, Y, Z) through a pixel, f the mean focal
// length of the camera. Nothing where the camera model has no such ray, or one
// by more than 84 degrees off the optical axis, where z-depth and image planes
// end.
std::optional<CenteredPoint> UndistortPoint(const colmap::Camera& camera,
                                            const Eigen::Vector2d& xy_px);

}  // namespace dgsfm
