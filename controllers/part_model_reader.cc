#include "controllers/part_model_reader.h"

#include "colmap_ext/model/model_io.h"

#include <sstream>
#include <stdexcept>
#include <unordered_map>

namespace dgsfm {

namespace {

// Indices of the points of a part by their ids.
using PointIndices = std::unordered_map<colmap::point3D_t, uint32_t>;

PointIndices ReadPoints(const std::string& folder, PartModel* part) {
  PointIndices indices;
  for (const ModelPoint& point : ReadModelPoints(folder)) {
    indices.emplace(point.point3D_id, uint32_t(part->points.size()));
    part->points.push_back(point.xyz);
    part->colors.push_back(point.color);
  }
  return indices;
}

PartModel::PartImage ReadImage(const ModelImageRecord& record,
                               const PointIndices& indices,
                               const PartModel& part) {
  PartModel::PartImage image;
  image.cam_from_part = record.image.cam_from_world;
  image.camera_id = record.image.camera_id;
  image.num_keypoints = record.image.observations.size();
  bool is_whole = part.cameras.count(image.camera_id) > 0;
  for (size_t i = 0; i < image.num_keypoints; ++i) {
    const ModelObservation& observation = record.image.observations[i];
    if (observation.point3D_id == colmap::kInvalidPoint3DId) continue;
    const auto index = indices.find(observation.point3D_id);
    is_whole &= index != indices.end();
    if (!is_whole) break;
    image.observations.push_back(
        {colmap::point2D_t(i), index->second, observation.xy.cast<float>()});
  }
  if (!is_whole) {
    throw std::runtime_error("model " + part.name +
                             " lacks cameras or points that its images "
                             "refer to; map the part again");
  }
  image.observations.shrink_to_fit();
  return image;
}

PartModel ReadPartModel(
    const std::string& folder,
    const std::unordered_map<std::string, colmap::image_t>& ids) {
  PartModel part;
  part.name = folder;
  for (const auto& [camera_id, camera] : ReadModelCameras(folder)) {
    part.cameras.emplace(camera_id, camera);
  }
  const PointIndices indices = ReadPoints(folder, &part);
  VisitModelImages(folder, [&](const ModelImageRecord& record) {
    const auto id = ids.find(record.name);
    if (id == ids.end()) {
      throw std::runtime_error("model " + folder + " has the image " +
                               record.name + ", which the database lacks");
    }
    part.images.emplace(id->second, ReadImage(record, indices, part));
  });
  return part;
}

}  // namespace

std::vector<PartModel> ReadPartModels(const std::string& paths,
                                      const Scene& scene) {
  std::unordered_map<std::string, colmap::image_t> ids;
  for (const auto& [image_id, image] : scene.images) {
    ids.emplace(image.Name(), image_id);
  }
  std::vector<PartModel> parts;
  std::istringstream stream(paths);
  std::string path;
  while (std::getline(stream, path, ',')) {
    if (path.empty()) continue;
    for (const std::string& folder : FindModels(path)) {
      parts.push_back(ReadPartModel(folder, ids));
    }
  }
  if (parts.empty()) throw std::runtime_error("input_paths names no models");
  return parts;
}

}  // namespace dgsfm
