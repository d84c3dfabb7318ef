#include "colmap_ext/model/rig_writer.h"

#include "colmap_ext/model/registered_images.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/pose_access.h"

#include <set>
#include <utility>

namespace dgsfm {

namespace {

// The rigs and frames of the registered images, those of one image too.
struct ModelRigs {
  RigScene rigs;
  std::map<frame_t, Rigid3d> rig_from_world;
};

// The rigs with those of their cameras alone whose poses are known and that the
// model has: COLMAP refuses others, and wants a camera in one rig. A rig
// without its reference has that of its first camera.
std::map<rig_t, Rig> RigsInModel(const std::map<rig_t, Rig>& rigs,
                                 const colmap::Reconstruction& model) {
  std::map<rig_t, Rig> in_model;
  for (const auto& [rig_id, rig] : rigs) {
    Rig present;
    for (const auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      if (!cam_from_rig || !model.ExistsCamera(camera_id)) continue;
      present.cam_from_rig[camera_id] = cam_from_rig;
    }
    if (present.cam_from_rig.empty()) continue;
    present.ref_camera_id = rig.ref_camera_id;
    if (present.cam_from_rig.count(rig.ref_camera_id) == 0) {
      const auto& [first_id, first_from_rig] = *present.cam_from_rig.begin();
      present.ref_camera_id = first_id;
      const Rigid3d rig_from_first = first_from_rig->Inverse();
      for (auto& [camera_id, cam_from_rig] : present.cam_from_rig) {
        cam_from_rig = *cam_from_rig * rig_from_first;
      }
    }
    in_model[rig_id] = std::move(present);
  }
  return in_model;
}

void AddFrames(const std::map<frame_t, Frame>& frames,
               const colmap::Reconstruction& model,
               std::set<colmap::image_t>* added,
               ModelRigs* all) {
  for (const auto& [frame_id, frame] : frames) {
    const auto rig = all->rigs.rigs.find(frame.rig_id);
    if (rig == all->rigs.rigs.end()) continue;
    for (const auto& [camera_id, image_id] : frame.images) {
      const auto cam_from_rig = rig->second.cam_from_rig.find(camera_id);
      if (!IsRegistered(model, image_id) ||
          cam_from_rig == rig->second.cam_from_rig.end()) {
        continue;
      }
      Frame& registered = all->rigs.frames[frame_id];
      registered.rig_id = frame.rig_id;
      registered.images[camera_id] = image_id;
      all->rig_from_world.emplace(frame_id,
                                  cam_from_rig->second->Inverse() *
                                      CamFromWorld(model.Image(image_id)));
      added->insert(image_id);
    }
  }
}

// Makes a frame of each image that is in none, and a rig of its camera.
void AddSingleImages(const colmap::Reconstruction& model,
                     const std::set<colmap::image_t>& added,
                     ModelRigs* all) {
  const auto next_id = [](const auto& map) {
    return map.empty() ? 1 : map.rbegin()->first + 1;
  };
  std::map<colmap::camera_t, rig_t> rig_of_camera;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    if (added.count(image_id) > 0) continue;
    const colmap::camera_t camera_id = model.Image(image_id).CameraId();
    auto rig = rig_of_camera.find(camera_id);
    if (rig == rig_of_camera.end()) {
      const rig_t rig_id = next_id(all->rigs.rigs);
      all->rigs.rigs[rig_id] = {camera_id, {{camera_id, Rigid3d()}}};
      rig = rig_of_camera.emplace(camera_id, rig_id).first;
    }
    const frame_t frame_id = next_id(all->rigs.frames);
    all->rigs.frames[frame_id] = {rig->second, {{camera_id, image_id}}};
    all->rig_from_world[frame_id] = CamFromWorld(model.Image(image_id));
  }
}

void WritePose(const Rigid3d& pose, OutputFile* file) {
  const Eigen::Vector4d qvec = QvecFromRotation(pose.rotation);
  for (int i = 0; i < 4; ++i) file->WriteNumber<double>(qvec(i));
  for (int i = 0; i < 3; ++i) file->WriteNumber<double>(pose.translation(i));
}

void WriteSensor(colmap::camera_t camera_id, OutputFile* file) {
  file->WriteNumber<int32_t>(kCameraSensorType);
  file->WriteNumber<uint32_t>(camera_id);
}

}  // namespace

void WriteRigs(const RigScene& rigs,
               const colmap::Reconstruction& model,
               const std::string& folder) {
  ModelRigs all;
  all.rigs.rigs = RigsInModel(rigs.rigs, model);
  std::set<colmap::image_t> added;
  AddFrames(rigs.frames, model, &added, &all);
  AddSingleImages(model, added, &all);

  OutputFile rig_file(folder + "/rigs.bin");
  rig_file.WriteNumber<uint64_t>(all.rigs.rigs.size());
  for (const auto& [rig_id, rig] : all.rigs.rigs) {
    rig_file.WriteNumber<uint32_t>(rig_id);
    rig_file.WriteNumber<uint32_t>(uint32_t(rig.cam_from_rig.size()));
    WriteSensor(rig.ref_camera_id, &rig_file);
    for (const auto& [camera_id, cam_from_rig] : rig.cam_from_rig) {
      if (camera_id == rig.ref_camera_id) continue;
      WriteSensor(camera_id, &rig_file);
      rig_file.WriteNumber<uint8_t>(cam_from_rig.has_value());
      if (cam_from_rig) WritePose(*cam_from_rig, &rig_file);
    }
  }
  rig_file.Commit();

  OutputFile frame_file(folder + "/frames.bin");
  frame_file.WriteNumber<uint64_t>(all.rigs.frames.size());
  for (const auto& [frame_id, frame] : all.rigs.frames) {
    frame_file.WriteNumber<uint32_t>(frame_id);
    frame_file.WriteNumber<uint32_t>(frame.rig_id);
    WritePose(all.rig_from_world.at(frame_id), &frame_file);
    frame_file.WriteNumber<uint32_t>(uint32_t(frame.images.size()));
    for (const auto& [camera_id, image_id] : frame.images) {
      WriteSensor(camera_id, &frame_file);
      frame_file.WriteNumber<uint64_t>(image_id);
    }
  }
  frame_file.Commit();
}

}  // namespace dgsfm
