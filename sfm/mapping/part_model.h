// Models of overlapping parts of a scene, and one of several of them.

#pragma once

#include "colmap_ext/rigid3.h"
#include "colmap_ext/scene.h"
#include "estimators/position_alignment.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <string>
#include <unordered_map>
#include <vector>

namespace dgsfm {

// A model of some images of the scene, in a frame of its own.
struct PartModel {
  struct PartImage {
    Rigid3d cam_from_part;
    // In `cameras`.
    colmap::camera_t camera_id = colmap::kInvalidCameraId;
    // Points of the model by the key points of the scene's image that see them.
    std::map<colmap::point2D_t, colmap::point3D_t> points;
  };
  // For messages.
  std::string name;
  std::map<colmap::image_t, PartImage> images;
  CameraMap cameras;
  std::unordered_map<colmap::point3D_t, Eigen::Vector3d> points;
};

// Parts in one frame.
struct PartGroup {
  std::vector<int> parts;
  std::vector<Similarity3d> group_from_part;
};

// One model of a group: each image has the pose of the part in which it sees
// most points, points that share an observation are one, and each camera entry
// of the scene has the parameters of the part with most of its images.
colmap::Reconstruction JoinGroup(const Scene& scene,
                                 const std::vector<PartModel>& parts,
                                 const PartGroup& group);

}  // namespace dgsfm
