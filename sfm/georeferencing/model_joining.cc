#include "sfm/georeferencing/model_joining.h"

#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace dgsfm {

namespace {

// Adds the cameras of a model; their ids in the joined model.
std::map<colmap::camera_t, colmap::camera_t> AddCameras(
    const colmap::Reconstruction& model,
    colmap::camera_t* next_camera_id,
    colmap::Reconstruction* joined) {
  std::map<colmap::camera_t, colmap::camera_t> ids;
  std::map<colmap::camera_t, const colmap::Camera*> sorted;
  for (const auto& [camera_id, camera] : model.Cameras()) {
    sorted[camera_id] = &camera;
  }
  for (const auto& [camera_id, camera] : sorted) {
    colmap::Camera added = *camera;
    if (joined->ExistsCamera(camera_id)) {
      if (joined->Camera(camera_id).Params() == camera->Params()) {
        ids[camera_id] = camera_id;
        continue;
      }
      added.SetCameraId((*next_camera_id)++);
    }
    joined->AddCamera(added);
    ids[camera_id] = added.CameraId();
  }
  return ids;
}

void AddModel(const colmap::Reconstruction& model,
              colmap::camera_t* next_camera_id,
              colmap::Reconstruction* joined) {
  const auto camera_ids = AddCameras(model, next_camera_id, joined);
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    colmap::Image image = model.Image(image_id);
    image.SetCameraId(camera_ids.at(image.CameraId()));
    image.SetRegistered(false);
    for (size_t i = 0; i < image.NumPoints2D(); ++i) {
      if (image.Point2D(i).HasPoint3D()) image.ResetPoint3DForPoint2D(i);
    }
    joined->AddImage(image);
    joined->RegisterImage(image_id);
  }
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    const colmap::Point3D& point = model.Point3D(point_id);
    const colmap::point3D_t joined_id =
        joined->AddPoint3D(point.XYZ(), point.Track(), point.Color());
    joined->Point3D(joined_id).SetError(point.Error());
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
    std::vector<ModelGeoreference>* georeferences) {
  const size_t num_georeferenced = std::count_if(
      georeferences->begin(), georeferences->end(), [](const auto& reference) {
        return reference.is_georeferenced;
      });
  if (num_georeferenced < 2) return;
  std::vector<std::unique_ptr<colmap::Reconstruction>> kept_models;
  std::vector<ModelGeoreference> kept_georeferences;
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
      continue;
    }
    AddModel(*(*models)[i], &first_new_camera_id, kept_models[joined].get());
    AddGeoreference(georeference, &kept_georeferences[joined]);
    kept_georeferences[joined].part_sizes.push_back(num_images);
  }
  *models = std::move(kept_models);
  *georeferences = std::move(kept_georeferences);
}

}  // namespace dgsfm
