// One model of several parts, in plain arrays, as it may be of far more images
// than a colmap::Reconstruction can hold.

#pragma once

#include "colmap_ext/rig.h"
#include "sfm/joining/part_joining.h"
#include "sfm/joining/part_model.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <cstdint>
#include <vector>

namespace dgsfm {

struct JoinedModel {
  struct Observation {
    // Index of the image.
    uint32_t image = 0;
    colmap::point2D_t point2D_idx = 0;
    Eigen::Vector2f xy_px = Eigen::Vector2f::Zero();
  };

  // Cameras and images without their key points, in increasing order of their
  // ids; all are registered.
  colmap::Reconstruction poses;
  std::vector<colmap::image_t> image_ids;

  // Places and colours of the points. Point i has the observations begins[i] to
  // begins[i + 1] - 1, in increasing order of the images, each once.
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3ub> colors;
  std::vector<size_t> begins;
  std::vector<Observation> observations;

  // Mean reprojection errors of the points [px]; empty if they are unknown.
  std::vector<double> point_errors_px;

  // Images of each part, as indices in increasing order.
  std::vector<std::vector<uint32_t>> blocks;

  size_t NumPoints() const { return points.size(); }
  // Changes the frame of poses and points.
  void Transform(const Similarity3d& new_from_old);
  // Removes the observations whose `keep` is false, and points with fewer than
  // two others.
  void Keep(const std::vector<bool>& keep);
};

// One model of a group: each image has the pose of the part in which it sees
// most points, points that share an observation are one, and cameras are those
// of CameraJoiner. The key points of the parts are numbered alike, see
// UnifyKeypoints(). Points and observations leave the parts of the group, so
// that memory has them once.
JoinedModel JoinGroup(const Scene& scene,
                      const PartGroup& group,
                      std::vector<PartModel>* parts);

}  // namespace dgsfm
