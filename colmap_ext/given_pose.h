// Pose priors as their sources have them.

#pragma once

#include <colmap/util/types.h>

#include <map>
#include <optional>

#include <Eigen/Core>

namespace dgsfm {

enum class PositionCoordinates {
  WGS84,      // latitude [deg], longitude [deg], altitude [m]
  CARTESIAN,  // x, y, z [m]
  UNDEFINED,  // the source does not say
};

struct GivenPose {
  // An altitude that is not finite is unknown.
  std::optional<Eigen::Vector3d> position;
  PositionCoordinates coordinates = PositionCoordinates::UNDEFINED;
  // Covariance of x, y, z, or of east, north, up [m^2].
  std::optional<Eigen::Matrix3d> covariance;
  // Downwards in the camera frame, of any length; zero = unknown.
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
};

using GivenPoses = std::map<colmap::image_t, GivenPose>;

}  // namespace dgsfm
