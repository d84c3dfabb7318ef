#include "controllers/part_model_reader.h"

#include "colmap_ext/model/model_io.h"

#include <sstream>
#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

// Key points of an image by their places, which models keep to the bit.
using KeypointIndex = std::map<std::pair<double, double>, colmap::point2D_t>;

KeypointIndex IndexKeypoints(const colmap::Image& image) {
  KeypointIndex index;
  for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
    const Eigen::Vector2d& xy = image.Point2D(i).XY();
    index.emplace(std::make_pair(xy.x(), xy.y()), i);
  }
  return index;
}

PartModel::PartImage ReadImage(const ModelImage& model_image,
                               const colmap::Image& image,
                               const std::string& folder) {
  PartModel::PartImage part_image;
  part_image.cam_from_part = model_image.cam_from_world;
  part_image.camera_id = model_image.camera_id;
  const KeypointIndex index = IndexKeypoints(image);
  size_t num_missing = 0;
  for (const ModelObservation& observation : model_image.observations) {
    const auto found = index.find({observation.xy.x(), observation.xy.y()});
    if (found == index.end()) {
      ++num_missing;
    } else {
      part_image.points.emplace(found->second, observation.point3D_id);
    }
  }
  // Each part selects its own key points of dense matches.
  if (2 * num_missing > model_image.observations.size()) {
    throw std::runtime_error("model " + folder + ": image " + image.Name() +
                             " has other key points than the database; map the "
                             "part again");
  }
  return part_image;
}

PartModel ReadPartModel(
    const std::string& folder,
    const std::map<std::string, const colmap::Image*>& images) {
  PartModel part;
  part.name = folder;
  for (const auto& [name, model_image] : ReadModelImages(folder)) {
    const auto image = images.find(name);
    if (image == images.end()) {
      throw std::runtime_error("model " + folder + " has the image " + name +
                               ", which the database lacks");
    }
    part.images.emplace(image->second->ImageId(),
                        ReadImage(model_image, *image->second, folder));
  }
  for (const auto& [camera_id, camera] : ReadModelCameras(folder)) {
    part.cameras.emplace(camera_id, camera);
  }
  for (const ModelPoint& point : ReadModelPoints(folder)) {
    part.points.emplace(point.point3D_id, point.xyz);
  }
  for (const auto& [image_id, image] : part.images) {
    bool is_whole = part.cameras.count(image.camera_id) > 0;
    for (const auto& [point2D_idx, point_id] : image.points) {
      is_whole &= part.points.count(point_id) > 0;
    }
    if (!is_whole) {
      throw std::runtime_error("model " + folder +
                               " lacks cameras or points that its images "
                               "refer to; map the part again");
    }
  }
  return part;
}

}  // namespace

std::vector<PartModel> ReadPartModels(const std::string& paths,
                                      const Scene& scene) {
  std::map<std::string, const colmap::Image*> images;
  for (const auto& [image_id, image] : scene.images) {
    images.emplace(image.Name(), &image);
  }
  std::vector<PartModel> parts;
  std::istringstream stream(paths);
  std::string path;
  while (std::getline(stream, path, ',')) {
    if (path.empty()) continue;
    for (const std::string& folder : FindModels(path)) {
      parts.push_back(ReadPartModel(folder, images));
    }
  }
  if (parts.empty() && !paths.empty()) {
    throw std::runtime_error("input_paths names no models");
  }
  return parts;
}

}  // namespace dgsfm
