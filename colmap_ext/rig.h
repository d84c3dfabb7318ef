// Cameras that move together, in the terms of COLMAP 3.12 and later.

#pragma once

#include "colmap_ext/rigid3.h"

#include <colmap/util/alignment.h>

#include <colmap/util/types.h>

#include <map>
#include <optional>
#include <set>
#include <vector>

namespace dgsfm {

using rig_t = uint32_t;
using frame_t = uint32_t;

// COLMAP's number of the sensor type "camera", in databases and models.
constexpr int kCameraSensorType = 0;

struct Rig {
  colmap::camera_t ref_camera_id = colmap::kInvalidCameraId;
  // The pose of each camera in the rig, whose frame is that of the reference
  // camera: identity there, nothing where it is unknown.
  std::map<colmap::camera_t, std::optional<Rigid3d>> cam_from_rig;
};

// Images that the cameras of a rig took at one time.
struct Frame {
  rig_t rig_id = 0;
  // One a camera at most.
  std::map<colmap::camera_t, colmap::image_t> images;
};

// The rigs of several cameras, and their frames; a camera is part of at most
// one rig, an image of at most one frame.
struct RigScene {
  std::map<rig_t, Rig> rigs;
  std::map<frame_t, Frame> frames;

  bool Empty() const { return frames.empty(); }
};

// Where an image is in a frame.
struct FrameMember {
  frame_t frame_id = 0;
  colmap::camera_t camera_id = colmap::kInvalidCameraId;
  Rigid3d cam_from_rig;
};

// The images of frames whose camera has a known pose in its rig.
using FrameMembers = std::map<colmap::image_t, FrameMember>;
FrameMembers MembersOf(const RigScene& rigs);

// Cameras whose pose in their rig is unknown, or with `all` all but references.
std::set<colmap::camera_t> CamerasToCalibrate(const RigScene& rigs, bool all);

// Whether frames fix the scale of a model of these images: two of one frame
// have different centres.
bool HasBaseline(const FrameMembers& frames,
                 const std::vector<colmap::image_t>& image_ids);

}  // namespace dgsfm
