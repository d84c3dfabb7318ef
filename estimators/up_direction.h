// The vertical of a model by how its cameras were held.

#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

struct LevelCamera {
  Eigen::Quaterniond cam_from_world = Eigen::Quaterniond::Identity();
  // Unit vector downwards in the camera frame; zero = unknown.
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
};

struct UpDirection {
  Eigen::Vector3d in_world = Eigen::Vector3d::UnitZ();
  // Median deviation of the cameras [rad].
  double spread_rad = 0;
  // Whether by gravity, else by cameras held level.
  bool is_by_gravity = false;
};

struct UpDirectionOptions {
  // Cameras whose horizontal axis is within this of level are held so [deg].
  double max_roll_deg = 10;
  // Share of the cameras that must be.
  double min_share = 0.6;
};

// Where up is: the geometric median of the directions that gravity gives, if
// most cameras have them within three times max_roll_deg of it; otherwise the
// direction that the horizontal axes of the cameras are square to, if most
// cameras are level then and most have it on their upper side. Cameras that
// all look the same way leave open how far they look down: the mean of their
// upper sides then counts. Nothing if the cameras do not agree.
std::optional<UpDirection> FindUpDirection(
    const UpDirectionOptions& options, const std::vector<LevelCamera>& cameras);

}  // namespace dgsfm
