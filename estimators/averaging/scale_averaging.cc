#include "estimators/averaging/scale_averaging.h"

#include "estimators/median.h"

#include <cmath>

namespace dgsfm {

bool AverageScales(int num_nodes,
                   const std::vector<RelativeLogScale>& ratios,
                   int fixed_node,
                   const GraphAveragingOptions& options,
                   std::vector<double>* log_scales) {
  std::vector<GraphEdge> edges;
  Eigen::MatrixXd log_ratios(ratios.size(), 1);
  Eigen::VectorXd stddevs(ratios.size());
  for (size_t e = 0; e < ratios.size(); ++e) {
    edges.emplace_back(ratios[e].node1, ratios[e].node2);
    log_ratios(e, 0) = ratios[e].log_ratio;
    stddevs(e) = ratios[e].stddev;
  }
  Eigen::MatrixXd values;
  if (!AverageDifferences(num_nodes,
                          edges,
                          log_ratios,
                          stddevs,
                          fixed_node,
                          options,
                          &values)) {
    return false;
  }
  log_scales->assign(values.data(), values.data() + num_nodes);
  return true;
}

std::vector<double> LogScaleSpreads(const std::vector<RelativeLogScale>& ratios,
                                    const std::vector<double>& log_scales) {
  std::vector<std::vector<double>> errors(log_scales.size());
  for (const RelativeLogScale& ratio : ratios) {
    const double error = std::abs(log_scales.at(ratio.node2) -
                                  log_scales.at(ratio.node1) - ratio.log_ratio);
    errors[ratio.node1].push_back(error);
    errors[ratio.node2].push_back(error);
  }
  std::vector<double> spreads;
  for (const std::vector<double>& node_errors : errors) {
    spreads.push_back(
        node_errors.empty() ? 0 : kStddevPerMad * Median(node_errors));
  }
  return spreads;
}

}  // namespace dgsfm
