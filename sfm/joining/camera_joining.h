// The cameras of models of parts as those of one model.

#pragma once

#include "sfm/joining/part_joining.h"
#include "sfm/joining/part_model.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <set>
#include <utility>
#include <vector>

namespace dgsfm {

// Mean parameters of a camera over the parts that have it.
class MeanCamera {
 public:
  // `num_observations` is the weight. The model is that of the camera with
  // most.
  void Add(const colmap::Camera& camera, size_t num_observations);
  bool Exists() const { return num_observations_ > 0; }
  colmap::Camera Mean() const;

 private:
  colmap::Camera camera_;
  size_t max_num_observations_ = 0;
  Eigen::VectorXd sum_;
  double num_observations_ = 0;
};

// The cameras of a group. A camera entry of the scene has the mean parameters
// of the parts that have it. Entries that some part gave the same parameters
// are tied: they have one mean. Cameras that a part gave to some images of an
// entry are cameras of their own.
class CameraJoiner {
 public:
  CameraJoiner(const Scene& scene,
               const std::vector<PartModel>& parts,
               const PartGroup& group);

  // The camera of an image that has the pose of a part.
  colmap::camera_t CameraOf(colmap::image_t image_id, int part);

  // Adds those that CameraOf() named.
  void WriteTo(colmap::Reconstruction* model);

 private:
  colmap::camera_t EntryOf(colmap::image_t image_id) const;
  colmap::camera_t RootOf(colmap::camera_t entry_id);
  void TieEntries(int part);
  void AddToMeans(int part);

  const Scene& scene_;
  const std::vector<PartModel>& parts_;
  colmap::camera_t next_id_ = 0;
  // Tied entries have one root.
  std::map<colmap::camera_t, colmap::camera_t> parents_;
  // Means by root.
  std::map<colmap::camera_t, MeanCamera> means_;
  std::set<colmap::camera_t> used_entries_;
  // Ids of the cameras that are no entries, by part and camera of the part.
  std::map<std::pair<int, colmap::camera_t>, colmap::camera_t> own_;
};

}  // namespace dgsfm
