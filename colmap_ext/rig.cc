#include "colmap_ext/rig.h"

namespace dgsfm {

namespace {

// Centres closer than this share of the distances that models are made of are
// one: rounding of a calibration, not a baseline.
constexpr double kMinBaseline = 1e-6;

}  // namespace

FrameMembers MembersOf(const RigScene& rigs) {
  FrameMembers members;
  for (const auto& [frame_id, frame] : rigs.frames) {
    const Rig& rig = rigs.rigs.at(frame.rig_id);
    for (const auto& [camera_id, image_id] : frame.images) {
      const std::optional<Rigid3d>& pose = rig.cam_from_rig.at(camera_id);
      if (pose) members[image_id] = {frame_id, camera_id, *pose};
    }
  }
  return members;
}

std::set<colmap::camera_t> CamerasToCalibrate(const RigScene& rigs, bool all) {
  std::set<colmap::camera_t> camera_ids;
  for (const auto& [rig_id, rig] : rigs.rigs) {
    for (const auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      if (!cam_from_rig || (all && camera_id != rig.ref_camera_id)) {
        camera_ids.insert(camera_id);
      }
    }
  }
  return camera_ids;
}

bool HasBaseline(const RigScene& rigs) {
  for (const auto& [rig_id, rig] : rigs.rigs) {
    for (const auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      if (cam_from_rig && cam_from_rig->translation.norm() > kMinBaseline) {
        return true;
      }
    }
  }
  return false;
}

}  // namespace dgsfm
