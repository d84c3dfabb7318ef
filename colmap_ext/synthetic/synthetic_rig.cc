#include "colmap_ext/synthetic/synthetic_rig.h"

#include <cmath>
#include <stdexcept>

#include <Eigen/Geometry>

namespace dgsfm {

namespace {

constexpr SyntheticRig kRigs[] = {SyntheticRig::NONE,
                                  SyntheticRig::STEREO,
                                  SyntheticRig::CUBE,
                                  SyntheticRig::VEHICLE};

// A camera at `center` in the frame of the reference (x right, y down, z
// ahead), turned by `angle_deg` about `axis`.
Rigid3d CamFromRig(double angle_deg,
                   const Eigen::Vector3d& axis,
                   const Eigen::Vector3d& center) {
  const Eigen::Quaterniond rotation(
      Eigen::AngleAxisd(-angle_deg * M_PI / 180, axis));
  return Rigid3d(rotation, rotation * -center);
}

}  // namespace

std::string SyntheticRigName(SyntheticRig rig) {
  switch (rig) {
    case SyntheticRig::NONE:
      return "none";
    case SyntheticRig::STEREO:
      return "stereo";
    case SyntheticRig::CUBE:
      return "cube";
    case SyntheticRig::VEHICLE:
      return "vehicle";
  }
  return "unknown";
}

SyntheticRig SyntheticRigFromName(const std::string& name) {
  for (const SyntheticRig rig : kRigs) {
    if (SyntheticRigName(rig) == name) return rig;
  }
  throw std::runtime_error("rig is '" + name +
                           "' but must be none, stereo, cube or vehicle");
}

std::vector<Rigid3d> CamsFromRig(SyntheticRig rig) {
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const Eigen::Vector3d right = Eigen::Vector3d::UnitX();
  const Eigen::Vector3d down = Eigen::Vector3d::UnitY();
  switch (rig) {
    case SyntheticRig::NONE:
      break;
    case SyntheticRig::STEREO:
      return {Rigid3d(), CamFromRig(0, down, {0.5, 0, 0})};
    case SyntheticRig::CUBE:
      return {Rigid3d(),
              CamFromRig(90, down, zero),
              CamFromRig(180, down, zero),
              CamFromRig(270, down, zero),
              CamFromRig(90, right, zero),
              CamFromRig(-90, right, zero)};
    case SyntheticRig::VEHICLE:
      return {Rigid3d(),
              CamFromRig(80, down, {0.8, 0, -0.6}),
              CamFromRig(180, down, {0, 0.1, -2}),
              CamFromRig(-80, down, {-0.8, 0, -0.6})};
  }
  return {Rigid3d()};
}

}  // namespace dgsfm
