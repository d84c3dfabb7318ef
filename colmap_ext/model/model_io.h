// Sparse models on disk, text or binary, as COLMAP 3.8 to 4.2 write them.
//
// Beside colmap::Reconstruction::Read because that aborts on a file that is
// missing or broken, needs all files, and refuses camera models later than
// 3.8. These functions read one file of a model folder each (the binary one if
// there are both), check every number, and throw std::runtime_error naming
// file and line or byte. rigs.* and frames.* of COLMAP 4 add nothing: images.*
// has the full poses.

#pragma once

#include "colmap_ext/rigid3.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>
#include <colmap/util/types.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace dgsfm {

// Where an image sees a point of the model [px].
struct ModelObservation {
  Eigen::Vector2d xy = Eigen::Vector2d::Zero();
  colmap::point3D_t point3D_id = colmap::kInvalidPoint3DId;
};

struct ModelImage {
  colmap::camera_t camera_id = colmap::kInvalidCameraId;
  Rigid3d cam_from_world;
  // Without the key points that see no point of the model; key points of other
  // programs need not be those of a database.
  std::vector<ModelObservation> observations;
};

// An image as its file has it.
struct ModelImageRecord {
  colmap::image_t image_id = colmap::kInvalidImageId;
  std::string name;
  // With all key points, those that see no point too.
  ModelImage image;
};

struct ModelPoint {
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  Eigen::Vector3ub color = Eigen::Vector3ub::Zero();
  size_t track_length = 0;
  colmap::point3D_t point3D_id = colmap::kInvalidPoint3DId;
};

// Folders of the models at a path: the path itself if it holds images.bin or
// images.txt, otherwise its sub-folders that do, sorted by name, without hidden
// ones. Throws if there are none.
std::vector<std::string> FindModels(const std::string& path);

// The one of these with most images; the first if there are several.
std::string FindLargestModel(const std::string& path);

// Registered images by name. An empty model is no error.
std::map<std::string, ModelImage> ReadModelImages(const std::string& folder);

// Calls visit(record) for one image after another, in the order of the file.
void VisitModelImages(
    const std::string& folder,
    const std::function<void(const ModelImageRecord&)>& visit);

// Throws if a camera model is not one of COLMAP 3.8.
std::map<colmap::camera_t, colmap::Camera> ReadModelCameras(
    const std::string& folder);

// In the order of the file.
std::vector<ModelPoint> ReadModelPoints(const std::string& folder);

}  // namespace dgsfm
