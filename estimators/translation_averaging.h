// One camera centre per image from the metric translations of pairs whose
// rotations and depth scales are known.

#pragma once

#include <string>
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

struct TranslationAveragingOptions {
  // Reweighted least-squares steps of each phase.
  int max_num_iterations = 30;
  // Scale of the robust loss in standard deviations of a translation [1].
  double loss_scale = 3.0;
  // Mean change of the errors, in standard deviations, below which the last
  // phase has converged [1]; the L1 phase stops at 1e-4 at the latest.
  double convergence_threshold = 1e-6;

  bool IsValid(std::string* error) const;
};

// Norms of the differences between translations and centres, in standard
// deviations.
std::vector<double> TranslationErrors(
    const std::vector<RelativeTranslation>& translations,
    const std::vector<Eigen::Vector3d>& centers);

// Centres of all nodes of a connected graph, gauge: zero at fixed_node; the
// length of the translations fixes the scale. Least squares, then an L1 phase
// (IRLS on the norms), then a redescending loss (Geman-McClure), so that a
// translation that contradicts the loops it is part of has no say. Returns
// false, centers unchanged, if the graph is not connected or a factorisation
// fails. Throws on translations that are not finite, standard deviations that
// are not finite and positive, and nodes out of range.
[[nodiscard]] bool AverageTranslations(
    int num_nodes,
    const std::vector<RelativeTranslation>& translations,
    int fixed_node,
    const TranslationAveragingOptions& options,
    std::vector<Eigen::Vector3d>* centers);

}  // namespace dgsfm
