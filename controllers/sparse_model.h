// A model on disk, and the depths of its points in its images.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/model/model_io.h"
#include "estimators/depth_alignment.h"

#include <map>
#include <string>
#include <unordered_map>
#include <vector>

namespace dgsfm {

struct SparseModel {
  std::string path;
  std::map<std::string, ModelImage> images;
  std::map<colmap::camera_t, colmap::Camera> cameras;
  std::unordered_map<colmap::point3D_t, Eigen::Vector3d> points;
};

// Reads a model, of a folder of several models the largest. Throws
// std::runtime_error naming the file.
SparseModel ReadSparseModel(const std::string& path);

// Throws std::runtime_error naming model and image if the model has not both.
const colmap::Camera& CameraOfImage(const SparseModel& model,
                                    const std::string& image_name);

// Points that an image of the model sees, with the depth of the map there,
// edges of depth left out.
std::vector<DepthCorrespondence> FindDepthCorrespondences(
    const SparseModel& model,
    const std::string& image_name,
    const DepthMap& depth_map);

// Turns a map of unknown scale and shift into depth in the unit of the model,
// by the points that its image sees; false if there are too few, or they do not
// fit.
bool ConvertByPoints(const SparseModel& model,
                     const std::string& image_name,
                     DepthMap* depth_map);

}  // namespace dgsfm
