#include "colmap_ext/rig.h"

namespace dgsfm {

namespace {

// Distances of centres below this are rounding of a calibration, not baselines
// [unit of the rig].
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

bool HasBaseline(const FrameMembers& frames,
                 const std::vector<colmap::image_t>& image_ids) {
  std::map<frame_t, Eigen::Vector3d> first_centers;
  for (const colmap::image_t image_id : image_ids) {
    const auto member = frames.find(image_id);
    if (member == frames.end()) continue;
    const Eigen::Vector3d center =
        member->second.cam_from_rig.TargetOriginInSource();
    const auto first =
        first_centers.emplace(member->second.frame_id, center).first;
    if ((center - first->second).norm() > kMinBaseline) return true;
  }
  return false;
}

}  // namespace dgsfm
