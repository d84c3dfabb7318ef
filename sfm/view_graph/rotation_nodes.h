// The nodes of rotation averaging: frames, and images that are in none.

#pragma once

#include "sfm/view_graph/view_graph.h"

#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

struct RotationNodes {
  int num_nodes = 0;
  // By image of the index.
  std::vector<int> node_of_image;
  std::vector<Eigen::Quaterniond> cam_from_node;

  RotationNodes(const ImageIndex& index, const FrameMembers& frames);

  // Rotations of the nodes by those of the images, which may be none.
  std::vector<Eigen::Quaterniond> NodeFromWorld(
      const std::vector<Eigen::Quaterniond>& cam_from_world) const;
  // Rotations of the images by those of the nodes.
  std::vector<Eigen::Quaterniond> CamFromWorld(
      const std::vector<Eigen::Quaterniond>& node_from_world) const;
};

}  // namespace dgsfm
