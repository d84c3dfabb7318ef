#include "sfm/mapping/center_chain.h"

#include "colmap_ext/pose_access.h"
#include "estimators/averaging/graph.h"

#include <algorithm>

namespace dgsfm {

Eigen::Vector3d ChainCenter(const Eigen::Vector3d& center1,
                            const Eigen::Quaterniond& rotation2,
                            const Rigid3d& cam2_from_cam1,
                            double unit) {
  return center1 - rotation2.conjugate() * (unit * cam2_from_cam1.translation);
}

std::vector<std::optional<Eigen::Vector3d>> ChainScaledCenters(
    const ImageIndex& index,
    const PairGeometries& pairs,
    const ImageScales& scales,
    const colmap::Reconstruction& model) {
  std::vector<std::optional<Eigen::Vector3d>> centers(index.Size());
  std::vector<GraphEdge> edges;
  std::vector<double> weights;
  std::vector<const PairGeometry*> edge_pairs;
  std::vector<double> strength(index.Size(), 0);
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (pair.status != PairStatus::VALID || !pair.has_scale ||
        scales.count(image_id1) == 0 || scales.count(image_id2) == 0) {
      continue;
    }
    edges.emplace_back(index.Of(image_id1), index.Of(image_id2));
    weights.push_back(double(pair.NumInliers()));
    edge_pairs.push_back(&pair);
    strength[edges.back().first] += weights.back();
    strength[edges.back().second] += weights.back();
  }
  if (edges.empty()) return centers;
  // Chains from the best connected image are short, and errors along them few.
  const int root = int(std::max_element(strength.begin(), strength.end()) -
                       strength.begin());
  const SpanningTree tree =
      MaximumSpanningTree(index.Size(), edges, weights, root);
  for (const int image : tree.order) {
    if (image == root) {
      centers[image] = Eigen::Vector3d::Zero();
      continue;
    }
    const int parent = tree.parents[image];
    const int edge = tree.parent_edges[image];
    const PairGeometry& pair = *edge_pairs[edge];
    const Rigid3d image_from_parent =
        edges[edge].first == parent
            ? pair.cam2_from_cam1
            : InverseScaledPose(pair.cam2_from_cam1, pair.scale_1_from_2);
    centers[image] =
        ChainCenter(*centers[parent],
                    CamFromWorld(model.Image(index.IdOf(image))).rotation,
                    image_from_parent,
                    scales.at(index.IdOf(parent)));
  }
  return centers;
}

}  // namespace dgsfm
