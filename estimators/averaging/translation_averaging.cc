#include "estimators/averaging/translation_averaging.h"

namespace dgsfm {

std::vector<double> TranslationErrors(
    const std::vector<RelativeTranslation>& translations,
    const std::vector<Eigen::Vector3d>& centers) {
  std::vector<double> errors;
  for (const RelativeTranslation& relative : translations) {
    const Eigen::Vector3d estimate =
        centers.at(relative.node2) - centers.at(relative.node1);
    errors.push_back((estimate - relative.translation).norm() /
                     relative.stddev);
  }
  return errors;
}

bool AverageTranslations(int num_nodes,
                         const std::vector<RelativeTranslation>& translations,
                         int fixed_node,
                         const GraphAveragingOptions& options,
                         std::vector<Eigen::Vector3d>* centers) {
  std::vector<GraphEdge> edges;
  Eigen::MatrixXd differences(translations.size(), 3);
  Eigen::VectorXd stddevs(translations.size());
  for (size_t e = 0; e < translations.size(); ++e) {
    edges.emplace_back(translations[e].node1, translations[e].node2);
    differences.row(e) = translations[e].translation.transpose();
    stddevs(e) = translations[e].stddev;
  }
  Eigen::MatrixXd values;
  if (!AverageDifferences(num_nodes,
                          edges,
                          differences,
                          stddevs,
                          fixed_node,
                          options,
                          &values)) {
    return false;
  }
  centers->clear();
  for (Eigen::Index i = 0; i < values.rows(); ++i) {
    centers->push_back(values.row(i).transpose());
  }
  return true;
}

}  // namespace dgsfm
