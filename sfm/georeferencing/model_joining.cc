#include "sfm/georeferencing/model_joining.h"

#include "colmap_ext/model/registered_images.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

namespace dgsfm {

namespace {

using CameraIds = std::map<colmap::camera_t, colmap::camera_t>;

// A model with its rigs.
struct RiggedModel {
  colmap::Reconstruction* model = nullptr;
  RigScene* rigs = nullptr;
};

bool IsEqual(const std::optional<Rigid3d>& pose1,
             const std::optional<Rigid3d>& pose2) {
  if (!pose1 || !pose2) return pose1.has_value() == pose2.has_value();
  return pose1->rotation.coeffs() == pose2->rotation.coeffs() &&
         pose1->translation == pose2->translation;
}

// Cameras of the part that are not those of the same id of the joined model, in
// the order of their ids.
std::set<colmap::camera_t> DifferingCameras(const RiggedModel& part,
                                            const RiggedModel& joined) {
  std::set<colmap::camera_t> differing;
  for (const auto& [camera_id, camera] : part.model->Cameras()) {
    if (joined.model->ExistsCamera(camera_id) &&
        joined.model->Camera(camera_id).Params() != camera.Params()) {
      differing.insert(camera_id);
    }
  }
  for (const auto& [rig_id, rig] : part.rigs->rigs) {
    const Rig& other = joined.rigs->rigs.at(rig_id);
    const bool differs = std::any_of(
        rig.cam_from_rig.begin(), rig.cam_from_rig.end(), [&](const auto& it) {
          return differing.count(it.first) > 0 ||
                 !IsEqual(it.second, other.cam_from_rig.at(it.first));
        });
    if (!differs) continue;
    for (const auto& [camera_id, pose] : rig.cam_from_rig) {
      differing.insert(camera_id);
    }
  }
  return differing;
}

// Adds the cameras of a part, and those of its rigs that it has no image of;
// their ids in the joined model.
CameraIds AddCameras(const RiggedModel& part,
                     colmap::camera_t* next_camera_id,
                     const RiggedModel& joined) {
  CameraIds ids;
  const std::set<colmap::camera_t> differing = DifferingCameras(part, joined);
  std::map<colmap::camera_t, colmap::Camera> sorted;
  for (const auto& [camera_id, camera] : part.model->Cameras()) {
    sorted[camera_id] = camera;
  }
  for (const auto& [rig_id, rig] : part.rigs->rigs) {
    for (const auto& [camera_id, pose] : rig.cam_from_rig) {
      if (sorted.count(camera_id) == 0 &&
          joined.model->ExistsCamera(camera_id)) {
        sorted[camera_id] = joined.model->Camera(camera_id);
      }
    }
  }
  for (auto& [camera_id, added] : sorted) {
    if (differing.count(camera_id) > 0) {
      added.SetCameraId((*next_camera_id)++);
    }
    ids[camera_id] = added.CameraId();
    if (!joined.model->ExistsCamera(added.CameraId())) {
      joined.model->AddCamera(added);
    }
  }
  return ids;
}

// The sensors of a rig or a frame by the new ids of their cameras; without
// those that neither model has.
template <typename Value>
std::map<colmap::camera_t, Value> Renamed(
    const std::map<colmap::camera_t, Value>& sensors,
    const CameraIds& camera_ids) {
  std::map<colmap::camera_t, Value> renamed;
  for (const auto& [camera_id, value] : sensors) {
    const auto new_id = camera_ids.find(camera_id);
    if (new_id != camera_ids.end()) renamed[new_id->second] = value;
  }
  return renamed;
}

// Gives the frames of a part whose cameras got new ids rigs of these. A frame
// whose other images are in the joined model, since its cameras have no known
// poses, falls in two.
void AddRigs(const RiggedModel& part,
             const CameraIds& camera_ids,
             const RiggedModel& joined) {
  std::map<rig_t, rig_t> new_rig_ids;
  for (const auto& [rig_id, rig] : part.rigs->rigs) {
    const auto reference = camera_ids.find(rig.ref_camera_id);
    if (reference == camera_ids.end() ||
        reference->second == reference->first) {
      continue;
    }
    new_rig_ids[rig_id] = joined.rigs->rigs.rbegin()->first + 1;
    joined.rigs->rigs[new_rig_ids[rig_id]] = {
        reference->second, Renamed(rig.cam_from_rig, camera_ids)};
  }
  for (const auto& [frame_id, frame] : part.rigs->frames) {
    const auto new_rig_id = new_rig_ids.find(frame.rig_id);
    if (new_rig_id == new_rig_ids.end()) continue;
    std::map<colmap::camera_t, colmap::image_t> images;
    for (const auto& [camera_id, image_id] : frame.images) {
      if (!IsRegistered(*part.model, image_id)) continue;
      images[camera_id] = image_id;
      joined.rigs->frames.at(frame_id).images.erase(camera_id);
    }
    if (images.empty()) continue;
    const auto is_joined = [&](const auto& it) {
      return IsRegistered(*joined.model, it.second);
    };
    const auto& others = joined.rigs->frames.at(frame_id).images;
    const frame_t new_frame_id =
        std::any_of(others.begin(), others.end(), is_joined)
            ? joined.rigs->frames.rbegin()->first + 1
            : frame_id;
    joined.rigs->frames[new_frame_id] = {new_rig_id->second,
                                         Renamed(images, camera_ids)};
  }
}

void AddModel(const RiggedModel& part,
              colmap::camera_t* next_camera_id,
              const RiggedModel& joined) {
  const colmap::Reconstruction& model = *part.model;
  const CameraIds camera_ids = AddCameras(part, next_camera_id, joined);
  AddRigs(part, camera_ids, joined);
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    colmap::Image image = model.Image(image_id);
    image.SetCameraId(camera_ids.at(image.CameraId()));
    image.SetRegistered(false);
    for (size_t i = 0; i < image.NumPoints2D(); ++i) {
      if (image.Point2D(i).HasPoint3D()) image.ResetPoint3DForPoint2D(i);
    }
    joined.model->AddImage(image);
    joined.model->RegisterImage(image_id);
  }
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    const colmap::Point3D& point = model.Point3D(point_id);
    const colmap::point3D_t joined_id =
        joined.model->AddPoint3D(point.XYZ(), point.Track(), point.Color());
    joined.model->Point3D(joined_id).SetError(point.Error());
  }
}

void AddGeoreference(const ModelGeoreference& added,
                     ModelGeoreference* joined) {
  joined->num_positions += added.num_positions;
  joined->num_inliers += added.num_inliers;
  joined->log_scale_stddev_of_positions =
      std::max(joined->log_scale_stddev_of_positions,
               added.log_scale_stddev_of_positions);
  joined->rotation_stddev_deg =
      std::max(joined->rotation_stddev_deg, added.rotation_stddev_deg);
  joined->spread = std::max(joined->spread, added.spread);
  joined->errors.insert(added.errors.begin(), added.errors.end());
  joined->MeasureErrors();
}

}  // namespace

void JoinGeoreferencedModels(
    colmap::camera_t first_new_camera_id,
    std::vector<std::unique_ptr<colmap::Reconstruction>>* models,
    std::vector<ModelGeoreference>* georeferences,
    std::vector<RigScene>* rigs) {
  const size_t num_georeferenced = std::count_if(
      georeferences->begin(), georeferences->end(), [](const auto& reference) {
        return reference.is_georeferenced;
      });
  if (num_georeferenced < 2) return;
  std::vector<std::unique_ptr<colmap::Reconstruction>> kept_models;
  std::vector<ModelGeoreference> kept_georeferences;
  std::vector<RigScene> kept_rigs;
  int joined = -1;
  for (size_t i = 0; i < models->size(); ++i) {
    ModelGeoreference& georeference = (*georeferences)[i];
    const size_t num_images = (*models)[i]->NumRegImages();
    if (!georeference.is_georeferenced || joined < 0) {
      if (georeference.is_georeferenced) {
        joined = int(kept_models.size());
        georeference.part_sizes = {num_images};
      }
      kept_models.push_back(std::move((*models)[i]));
      kept_georeferences.push_back(std::move(georeference));
      kept_rigs.push_back(std::move((*rigs)[i]));
      continue;
    }
    AddModel({(*models)[i].get(), &(*rigs)[i]},
             &first_new_camera_id,
             {kept_models[joined].get(), &kept_rigs[joined]});
    AddGeoreference(georeference, &kept_georeferences[joined]);
    kept_georeferences[joined].part_sizes.push_back(num_images);
  }
  *models = std::move(kept_models);
  *georeferences = std::move(kept_georeferences);
  *rigs = std::move(kept_rigs);
}

}  // namespace dgsfm
