// Frames in a model: poses of cameras in their rigs by those of the images, and
// back.

#pragma once

#include "colmap_ext/rig.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <optional>
#include <set>

namespace dgsfm {

// The rigs with the poses of some cameras by the images of a model: robust
// averages over the frames that have these cameras and the reference. Where
// there is no such frame the pose stays.
RigScene CalibrateRigs(const std::set<colmap::camera_t>& camera_ids,
                       const colmap::Reconstruction& model,
                       const RigScene& rigs);

// Cameras whose pose in their rig is known, references aside.
std::set<colmap::camera_t> KnownSensors(const RigScene& rigs);

// How far a camera is from where its rig has it.
struct SensorError {
  double rotation_rad = 0;
  double center = 0;  // [unit of the rig]
};

// The errors of given poses of cameras by a model in the unit of the rigs.
std::map<colmap::camera_t, SensorError> SensorErrors(
    const std::set<colmap::camera_t>& camera_ids,
    const colmap::Reconstruction& model,
    const RigScene& rigs);

// Cameras of known pose, references aside, that a model has turned in their
// rig: models hold the others to rounding.
std::set<colmap::camera_t> TurnedSensors(const colmap::Reconstruction& model,
                                         const RigScene& rigs);

// Ratio of the unit of a model to that of the rigs by the distances of the
// images of frames along the baselines of the rigs, or in any direction where
// these point elsewhere; nothing if no frame has two registered images of
// different centres.
std::optional<double> ModelFromRigScale(const FrameMembers& frames,
                                        const colmap::Reconstruction& model);

// Moves the registered images of frames so that they are where the rigs have
// them: the pose of a frame is the robust average of what its images make of
// it. Images of these frames that are not registered become so.
void JoinFrames(const FrameMembers& frames, colmap::Reconstruction* model);

}  // namespace dgsfm
