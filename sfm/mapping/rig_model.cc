#include "sfm/mapping/rig_model.h"

#include "colmap_ext/model/registered_images.h"
#include "colmap_ext/pose_access.h"
#include "estimators/averaging/median_rotation.h"
#include "estimators/median.h"
#include "estimators/optimization/ray_intersection.h"

#include <vector>

namespace dgsfm {

namespace {

// Share of distances along the given baselines below which these point
// elsewhere.
constexpr double kMinAlignedShare = 0.5;

// Angle beyond which a camera is not held [rad].
constexpr double kMaxHeldAngle = 1e-6;

// What several images make of one pose.
struct Poses {
  std::vector<Eigen::Quaterniond> rotations;
  std::vector<Eigen::Vector3d> positions;
};

using FrameImages = std::map<frame_t, std::vector<colmap::image_t>>;

FrameImages ImagesOfFrames(const FrameMembers& frames,
                           const colmap::Reconstruction& model) {
  FrameImages images;
  for (const auto& [image_id, member] : frames) {
    if (model.ExistsImage(image_id)) {
      images[member.frame_id].push_back(image_id);
    }
  }
  return images;
}

}  // namespace

RigScene CalibrateRigs(const std::set<colmap::camera_t>& camera_ids,
                       const colmap::Reconstruction& model,
                       const RigScene& rigs) {
  std::map<colmap::camera_t, Poses> poses;
  for (const auto& [frame_id, frame] : rigs.frames) {
    const auto reference =
        frame.images.find(rigs.rigs.at(frame.rig_id).ref_camera_id);
    if (reference == frame.images.end() ||
        !IsRegistered(model, reference->second)) {
      continue;
    }
    const Rigid3d world_from_rig =
        CamFromWorld(model.Image(reference->second)).Inverse();
    for (const auto& [camera_id, image_id] : frame.images) {
      if (camera_ids.count(camera_id) == 0 || !IsRegistered(model, image_id)) {
        continue;
      }
      const Rigid3d cam_from_rig =
          CamFromWorld(model.Image(image_id)) * world_from_rig;
      poses[camera_id].rotations.push_back(cam_from_rig.rotation);
      poses[camera_id].positions.push_back(cam_from_rig.translation);
    }
  }
  RigScene calibrated = rigs;
  for (auto& [rig_id, rig] : calibrated.rigs) {
    for (auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      const auto found = poses.find(camera_id);
      if (found == poses.end()) continue;
      cam_from_rig = Rigid3d(MedianRotation(found->second.rotations),
                             ComponentwiseMedian(found->second.positions));
    }
  }
  return calibrated;
}

std::set<colmap::camera_t> KnownSensors(const RigScene& rigs) {
  std::set<colmap::camera_t> camera_ids;
  for (const auto& [rig_id, rig] : rigs.rigs) {
    for (const auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      if (cam_from_rig && camera_id != rig.ref_camera_id) {
        camera_ids.insert(camera_id);
      }
    }
  }
  return camera_ids;
}

std::map<colmap::camera_t, SensorError> SensorErrors(
    const std::set<colmap::camera_t>& camera_ids,
    const colmap::Reconstruction& model,
    const RigScene& rigs) {
  const RigScene found = CalibrateRigs(camera_ids, model, rigs);
  std::map<colmap::camera_t, SensorError> errors;
  for (const auto& [rig_id, rig] : rigs.rigs) {
    for (const auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      if (camera_ids.count(camera_id) == 0) continue;
      const Rigid3d& pose = *found.rigs.at(rig_id).cam_from_rig.at(camera_id);
      errors[camera_id] = {
          cam_from_rig->rotation.angularDistance(pose.rotation),
          (cam_from_rig->TargetOriginInSource() - pose.TargetOriginInSource())
              .norm()};
    }
  }
  return errors;
}

std::set<colmap::camera_t> TurnedSensors(const colmap::Reconstruction& model,
                                         const RigScene& rigs) {
  std::set<colmap::camera_t> turned;
  for (const auto& [camera_id, error] :
       SensorErrors(KnownSensors(rigs), model, rigs)) {
    if (error.rotation_rad > kMaxHeldAngle) turned.insert(camera_id);
  }
  return turned;
}

std::optional<double> ModelFromRigScale(const FrameMembers& frames,
                                        const colmap::Reconstruction& model) {
  std::vector<double> ratios, length_ratios;
  for (const auto& [frame_id, image_ids] : ImagesOfFrames(frames, model)) {
    for (size_t i = 0; i < image_ids.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        if (!IsRegistered(model, image_ids[i]) ||
            !IsRegistered(model, image_ids[j])) {
          continue;
        }
        const Rigid3d& cam_from_rig = frames.at(image_ids[i]).cam_from_rig;
        const Eigen::Vector3d baseline =
            cam_from_rig.TargetOriginInSource() -
            frames.at(image_ids[j]).cam_from_rig.TargetOriginInSource();
        if (!(baseline.norm() > 0)) continue;
        const Rigid3d cam_from_world = CamFromWorld(model.Image(image_ids[i]));
        const Eigen::Quaterniond world_from_rig =
            cam_from_world.rotation.conjugate() * cam_from_rig.rotation;
        const Eigen::Vector3d distance =
            cam_from_world.TargetOriginInSource() -
            CamFromWorld(model.Image(image_ids[j])).TargetOriginInSource();
        ratios.push_back((world_from_rig * baseline).dot(distance) /
                         baseline.squaredNorm());
        length_ratios.push_back(distance.norm() / baseline.norm());
      }
    }
  }
  if (ratios.empty()) return std::nullopt;
  const double ratio = Median(ratios);
  const double length_ratio = Median(length_ratios);
  return ratio > kMinAlignedShare * length_ratio ? ratio : length_ratio;
}

void JoinFrames(const FrameMembers& frames, colmap::Reconstruction* model) {
  for (const auto& [frame_id, image_ids] : ImagesOfFrames(frames, *model)) {
    Poses poses;
    for (const colmap::image_t image_id : image_ids) {
      if (!IsRegistered(*model, image_id)) continue;
      const Rigid3d rig_from_world =
          frames.at(image_id).cam_from_rig.Inverse() *
          CamFromWorld(model->Image(image_id));
      poses.rotations.push_back(rig_from_world.rotation);
      // Centres, since translations depend on the rotations.
      poses.positions.push_back(rig_from_world.TargetOriginInSource());
    }
    if (poses.rotations.empty()) continue;
    const Eigen::Quaterniond rotation = MedianRotation(poses.rotations);
    const Rigid3d rig_from_world(
        rotation, rotation * -ComponentwiseMedian(poses.positions));
    for (const colmap::image_t image_id : image_ids) {
      SetCamFromWorld(frames.at(image_id).cam_from_rig * rig_from_world,
                      &model->Image(image_id));
      if (!IsRegistered(*model, image_id)) model->RegisterImage(image_id);
    }
  }
}

}  // namespace dgsfm
