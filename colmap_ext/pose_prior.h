// What is known of the pose of an image before mapping, e.g. by GPS.

#pragma once

#include <colmap/util/types.h>

#include <limits>
#include <map>

#include <Eigen/Core>

namespace dgsfm {

struct PosePrior {
  // Projection centre in the common frame of the priors [m]; not finite =
  // unknown.
  Eigen::Vector3d position =
      Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  // Covariance of the position in that frame [m^2].
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  // Whether the source gave the covariance; otherwise it is a guess.
  bool has_covariance = false;
  // Unit vector downwards in the camera frame (x right, y down, z ahead); zero
  // = unknown.
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();

  bool HasPosition() const { return position.allFinite(); }
  bool HasGravity() const { return !gravity.isZero(0); }
};

using PosePriors = std::map<colmap::image_t, PosePrior>;

}  // namespace dgsfm
