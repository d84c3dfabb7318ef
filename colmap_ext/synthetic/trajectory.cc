#include "colmap_ext/synthetic/trajectory.h"

#include "colmap_ext/synthetic/synthetic_camera.h"

#include <cmath>
#include <stdexcept>

namespace dgsfm {

namespace {

// Columns of a grid twice as wide as high.
int NumGridColumns(int num_images) {
  return static_cast<int>(std::ceil(std::sqrt(2. * num_images)));
}

}  // namespace

std::string TrajectoryName(Trajectory trajectory) {
  switch (trajectory) {
    case Trajectory::RING:
      return "ring";
    case Trajectory::STREET:
      return "street";
    case Trajectory::FACADE:
      return "facade";
  }
  throw std::invalid_argument("unknown trajectory");
}

Trajectory TrajectoryFromName(const std::string& name) {
  for (const Trajectory trajectory :
       {Trajectory::RING, Trajectory::STREET, Trajectory::FACADE}) {
    if (name == TrajectoryName(trajectory)) return trajectory;
  }
  throw std::runtime_error("trajectory '" + name +
                           "' must be ring, street or facade");
}

SurfacePoint TrajectoryLayout::DrawPoint(RandomStream* random) const {
  Eigen::Vector3d xyz, normal;
  if (trajectory == Trajectory::RING) {
    const double azimuth = random->Uniform(0, 2 * M_PI);
    normal = {std::cos(azimuth), std::sin(azimuth), 0};
    xyz = random->Uniform(2.5, 4) * normal;
    xyz.z() = random->Uniform(-3, 3);
  } else if (trajectory == Trajectory::STREET) {
    const double side = random->Uniform() < 0.5 ? -1 : 1;
    normal = Eigen::Vector3d(-1, -0.5 * side, 0).normalized();
    xyz.x() = random->Uniform(2, 1.5 * num_images + max_depth);
    xyz.y() = side * random->Uniform(5, 9);
    xyz.z() = random->Uniform(-1.5, 6);
  } else {
    const int num_columns = NumGridColumns(num_images);
    const int num_rows = (num_images + num_columns - 1) / num_columns;
    normal = {0, -1, 0};
    xyz.x() = random->Uniform(-4, 2 * num_columns + 2);
    xyz.y() = random->Uniform(10, 13);
    xyz.z() = random->Uniform(-4, 1.5 * num_rows + 2.5);
  }
  return {origin + xyz, normal};
}

Rigid3d TrajectoryLayout::DrawPose(int i, RandomStream* random) const {
  Eigen::Vector3d center, target;
  if (trajectory == Trajectory::RING) {
    const double azimuth = 2 * M_PI * i / num_images;
    center = {12 * std::cos(azimuth), 12 * std::sin(azimuth), 1};
    target.setZero();
  } else if (trajectory == Trajectory::STREET) {
    center = {1.5 * i, 0, 0};
    target = center + Eigen::Vector3d(10, 0, 0);
  } else {
    const int num_columns = NumGridColumns(num_images);
    center = {2. * (i % num_columns), 0, 1.5 * (i / num_columns)};
    target = center + Eigen::Vector3d(0, 10, 0);
  }
  // Hand-held: nothing is exactly on a line, and cameras are rolled by up
  // to three degrees.
  for (int k = 0; k < 3; ++k) {
    center(k) += random->Uniform(-0.3, 0.3);
    target(k) += random->Uniform(-0.5, 0.5);
  }
  const Eigen::Quaterniond roll(Eigen::AngleAxisd(random->Uniform(-0.05, 0.05),
                                                  Eigen::Vector3d::UnitZ()));
  return Rigid3d(roll, Eigen::Vector3d::Zero()) *
         LookAt(origin + center, origin + target);
}

}  // namespace dgsfm
