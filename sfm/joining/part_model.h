// Models of overlapping parts of a scene.

#pragma once

#include "colmap_ext/rigid3.h"
#include "colmap_ext/scene.h"

#include <colmap/util/alignment.h>

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// A model of some images of the scene, in a frame of its own.
struct PartModel {
  // A key point that sees a point.
  struct Observation {
    colmap::point2D_t point2D_idx = 0;
    // Index of the point.
    uint32_t point = 0;
    // COLMAP's databases have key points of 32 bits.
    Eigen::Vector2f xy_px = Eigen::Vector2f::Zero();
  };
  struct PartImage {
    Rigid3d cam_from_part;
    // In `cameras`.
    colmap::camera_t camera_id = colmap::kInvalidCameraId;
    size_t num_keypoints = 0;
    // In increasing order of the key points.
    std::vector<Observation> observations;
  };

  // Its folder.
  std::string name;
  std::map<colmap::image_t, PartImage> images;
  CameraMap cameras;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3ub> colors;
};

// Key points that the image of the first part lacks, by their numbers from that
// image's num_keypoints on.
using AddedKeypoints = std::map<colmap::image_t, std::vector<Eigen::Vector2f>>;

// Numbers the key points of images of several parts alike, as the first of
// these parts has them. Parts list all key points of the database in its order,
// where nothing changes, or those that they chose from dense matches: these are
// found by their places, and added where the first part did not choose them.
AddedKeypoints UnifyKeypoints(std::vector<PartModel>* parts);

// Observations that two parts have of one key point, as pairs of indices of
// their points.
std::vector<std::pair<uint32_t, uint32_t>> SharedPoints(
    const PartModel::PartImage& image1, const PartModel::PartImage& image2);

}  // namespace dgsfm
