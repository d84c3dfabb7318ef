// Relative pose with depth scale and focal lengths as the estimators of an
// image pair exchange it.

#pragma once

#include "estimators/rotation_vector.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

// X2 = rotation * X1 + translation in camera frames 1 and 2; the point of a
// match lies at depth1 * (x1 / focal1, 1) in frame 1 and at
// scale * depth2 * (x2 / focal2, 1) in frame 2 (see
// two_view_geometry_depth.h). Without depth the translation has unit length
// and the scale has no meaning.
struct TwoViewModel {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double scale = 1;
  double focal1 = 1;
  double focal2 = 1;

  bool IsFinite() const {
    return rotation.allFinite() && translation.allFinite() && scale > 0 &&
           focal1 > 0 && focal2 > 0 && scale < 1e100 && focal1 < 1e100 &&
           focal2 < 1e100;
  }

  Eigen::Matrix3d EssentialMatrix() const {
    return CrossMatrix(translation) * rotation;
  }

  // (x2, 1)^T F (x1, 1) = 0 for image points relative to the principal points.
  Eigen::Matrix3d FundamentalMatrix() const {
    return Eigen::Vector3d(1 / focal2, 1 / focal2, 1).asDiagonal() *
           EssentialMatrix() *
           Eigen::Vector3d(1 / focal1, 1 / focal1, 1).asDiagonal();
  }

  // The same geometry seen from image 2; the gauge moves to depth map 2.
  TwoViewModel Inverse() const {
    TwoViewModel inverse;
    inverse.rotation = rotation.transpose();
    inverse.translation = -(rotation.transpose() * translation) / scale;
    inverse.scale = 1 / scale;
    inverse.focal1 = focal2;
    inverse.focal2 = focal1;
    return inverse;
  }
};

}  // namespace dgsfm
