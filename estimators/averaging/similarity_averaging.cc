#include "estimators/averaging/similarity_averaging.h"

#include "estimators/averaging/rotation_averaging.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/averaging/translation_averaging.h"

#include <cmath>

namespace dgsfm {

namespace {

bool AverageRotationsAndScales(
    int num_nodes,
    const std::vector<RelativeSimilarity>& similarities,
    int fixed_node,
    const GraphAveragingOptions& options,
    std::vector<Similarity3d>* world_from_node) {
  std::vector<RelativeRotation> rotations;
  std::vector<RelativeLogScale> ratios;
  for (const RelativeSimilarity& edge : similarities) {
    rotations.push_back({edge.node1,
                         edge.node2,
                         edge.node2_from_node1.rotation,
                         edge.rotation_stddev_rad});
    ratios.push_back({edge.node1,
                      edge.node2,
                      -std::log(edge.node2_from_node1.scale),
                      edge.log_scale_stddev});
  }
  std::vector<Eigen::Quaterniond> node_from_world;
  std::vector<double> log_scales;
  if (!AverageRotations(
          num_nodes, rotations, fixed_node, options, &node_from_world) ||
      !AverageScales(num_nodes, ratios, fixed_node, options, &log_scales)) {
    return false;
  }
  const Eigen::Quaterniond fixed = node_from_world[fixed_node];
  world_from_node->assign(num_nodes, Similarity3d());
  for (int node = 0; node < num_nodes; ++node) {
    Similarity3d& similarity = (*world_from_node)[node];
    similarity.rotation =
        (fixed * node_from_world[node].conjugate()).normalized();
    similarity.scale = std::exp(log_scales[node]);
  }
  return true;
}

}  // namespace

bool AverageSimilarities(int num_nodes,
                         const std::vector<RelativeSimilarity>& similarities,
                         int fixed_node,
                         const GraphAveragingOptions& options,
                         std::vector<Similarity3d>* world_from_node) {
  std::vector<Similarity3d> averaged;
  if (!AverageRotationsAndScales(
          num_nodes, similarities, fixed_node, options, &averaged)) {
    return false;
  }
  // Without translations yet, so that the anchors are relative to the origins.
  std::vector<RelativeTranslation> translations;
  for (const RelativeSimilarity& edge : similarities) {
    const Similarity3d& world_from_1 = averaged[edge.node1];
    const Eigen::Vector3d anchor_of_1 = world_from_1 * edge.anchor_in_1;
    const Eigen::Vector3d anchor_of_2 =
        averaged[edge.node2] * (edge.node2_from_node1 * edge.anchor_in_1);
    translations.push_back({edge.node1,
                            edge.node2,
                            anchor_of_1 - anchor_of_2,
                            world_from_1.scale * edge.anchor_stddev});
  }
  std::vector<Eigen::Vector3d> origins;
  if (!AverageTranslations(
          num_nodes, translations, fixed_node, options, &origins)) {
    return false;
  }
  for (int node = 0; node < num_nodes; ++node) {
    averaged[node].translation = origins[node];
  }
  *world_from_node = std::move(averaged);
  return true;
}

}  // namespace dgsfm
