// Families of camera paths and the surfaces along them.

#pragma once

#include "colmap_ext/rigid3.h"
#include "colmap_ext/synthetic/random_stream.h"

#include <string>

#include <Eigen/Core>

namespace dgsfm {

// RING: around an object, looking at it. STREET: forward along a street,
// 1.5 m per image. FACADE: a grid of viewpoints before a facade.
enum class Trajectory { RING, STREET, FACADE };

// Name as on the command line ("ring", "street", "facade"), and back; throws
// std::runtime_error on an unknown name.
std::string TrajectoryName(Trajectory trajectory);
Trajectory TrajectoryFromName(const std::string& name);

struct SurfacePoint {
  Eigen::Vector3d xyz;     // [m]
  Eigen::Vector3d normal;  // unit
};

// Points and poses of one trajectory of `num_images` images that starts at
// `origin`; the world's z axis points up [m].
struct TrajectoryLayout {
  Trajectory trajectory = Trajectory::RING;
  int num_images = 1;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  // How far points are seen, and surfaces of a street reach beyond its end.
  double max_depth = 40;

  SurfacePoint DrawPoint(RandomStream* random) const;
  // Pose of image i, as of a hand-held camera.
  Rigid3d DrawPose(int i, RandomStream* random) const;
};

}  // namespace dgsfm
