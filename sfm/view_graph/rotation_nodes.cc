#include "sfm/view_graph/rotation_nodes.h"

#include <map>

namespace dgsfm {

RotationNodes::RotationNodes(const ImageIndex& index,
                             const FrameMembers& frames)
    : cam_from_node(index.Size(), Eigen::Quaterniond::Identity()) {
  std::map<frame_t, int> node_of_frame;
  for (int i = 0; i < index.Size(); ++i) {
    const auto member = frames.find(index.IdOf(i));
    if (member == frames.end()) {
      node_of_image.push_back(num_nodes++);
      continue;
    }
    cam_from_node[i] = member->second.cam_from_rig.rotation;
    const auto [node, is_new] =
        node_of_frame.emplace(member->second.frame_id, num_nodes);
    num_nodes += is_new;
    node_of_image.push_back(node->second);
  }
}

std::vector<Eigen::Quaterniond> RotationNodes::NodeFromWorld(
    const std::vector<Eigen::Quaterniond>& cam_from_world) const {
  std::vector<Eigen::Quaterniond> node_from_world;
  for (size_t i = 0; i < cam_from_world.size(); ++i) {
    if (node_of_image[i] < int(node_from_world.size())) continue;
    node_from_world.push_back(cam_from_node[i].conjugate() * cam_from_world[i]);
  }
  return node_from_world;
}

std::vector<Eigen::Quaterniond> RotationNodes::CamFromWorld(
    const std::vector<Eigen::Quaterniond>& node_from_world) const {
  std::vector<Eigen::Quaterniond> cam_from_world;
  for (size_t i = 0; i < node_of_image.size(); ++i) {
    cam_from_world.push_back(cam_from_node[i] *
                             node_from_world[node_of_image[i]]);
  }
  return cam_from_world;
}

}  // namespace dgsfm
