// One camera centre per image from the metric translations of pairs whose
// rotations and depth scales are known.

#pragma once

#include "estimators/averaging/graph_averaging.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// c_2 - c_1 = translation in the world frame, where c_i is the centre of
// camera i.
struct RelativeTranslation {
  int node1 = 0;
  int node2 = 0;
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  // Standard deviation of each component [unit of the translation], > 0.
  double stddev = 1;
};

// Norms of the differences between translations and centres, in standard
// deviations.
std::vector<double> TranslationErrors(
    const std::vector<RelativeTranslation>& translations,
    const std::vector<Eigen::Vector3d>& centers);

// Centres of all nodes of a connected graph, gauge: zero at fixed_node; the
// length of the translations fixes the scale. A translation that contradicts
// its loops has no influence. See AverageDifferences for loss, failure
// and contract.
[[nodiscard]] bool AverageTranslations(
    int num_nodes,
    const std::vector<RelativeTranslation>& translations,
    int fixed_node,
    const GraphAveragingOptions& options,
    std::vector<Eigen::Vector3d>* centers);

}  // namespace dgsfm
