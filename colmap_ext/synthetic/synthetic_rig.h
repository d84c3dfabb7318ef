// Rigs of cameras in synthetic scenes.

#pragma once

#include "colmap_ext/rigid3.h"

#include <string>
#include <vector>

namespace dgsfm {

enum class SyntheticRig {
  NONE,     // images move by themselves
  STEREO,   // two cameras, 0.5 m apart
  CUBE,     // a 360-degree image as six of 90 degrees, with one centre
  VEHICLE,  // ahead, to the right, back and to the left, about a metre apart
};

// Name as on the command line ("stereo"), and back; throws std::runtime_error
// on an unknown name.
std::string SyntheticRigName(SyntheticRig rig);
SyntheticRig SyntheticRigFromName(const std::string& name);

// The pose of each camera in its rig, the first of which is the reference [m].
// One camera, identity, for NONE.
std::vector<Rigid3d> CamsFromRig(SyntheticRig rig);

}  // namespace dgsfm
