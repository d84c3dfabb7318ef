#include "sfm/view_graph/pair_lengths.h"

#include "estimators/averaging/graph.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/median.h"
#include "sfm/view_graph/pair_views.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Ratios of a pair to stronger ones at each of its images, at most.
constexpr int kMaxNumRatios = 4;

// Ratios of the lengths of pairs by their views at an image that they share.
std::vector<RelativeLogScale> RatiosOfViews(
    const std::vector<PairView>& views) {
  std::vector<RelativeLogScale> ratios;
  for (size_t i = 0; i < views.size(); ++i) {
    int num_ratios = 0;
    for (size_t j = 0; j < i && num_ratios < kMaxNumRatios; ++j) {
      const std::optional<double> log_ratio = LogRatio(views[j], views[i]);
      if (!log_ratio) continue;
      // The larger depths are in units of a length, the smaller it is.
      ratios.push_back({views[j].pair, views[i].pair, *log_ratio});
      ++num_ratios;
    }
  }
  return ratios;
}

std::vector<RelativeLogScale> RatiosOfLengths(
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<IndexedPair>& pairs,
    int num_threads) {
  std::vector<std::vector<RelativeLogScale>> ratios_at_images(index.Size());
  VisitViews(scene,
             index,
             pairs,
             num_threads,
             [&](int image, const std::vector<PairView>& views) {
               ratios_at_images[image] = RatiosOfViews(views);
             });
  std::vector<RelativeLogScale> ratios;
  for (const auto& at_image : ratios_at_images) {
    ratios.insert(ratios.end(), at_image.begin(), at_image.end());
  }
  return ratios;
}

}  // namespace

std::map<int, double> LengthsOfPairs(const Scene& scene,
                                     const ImageIndex& index,
                                     const std::vector<IndexedPair>& pairs,
                                     const GraphAveragingOptions& options,
                                     int num_threads) {
  const std::vector<RelativeLogScale> ratios =
      RatiosOfLengths(scene, index, pairs, num_threads);
  std::map<int, double> lengths;
  if (ratios.empty()) return lengths;
  std::vector<GraphEdge> edges;
  for (const RelativeLogScale& ratio : ratios) {
    edges.emplace_back(ratio.node1, ratio.node2);
  }
  const std::vector<int> pair_of_node =
      LargestComponent(int(pairs.size()), edges);
  std::vector<int> node_of_pair(pairs.size(), -1);
  for (size_t node = 0; node < pair_of_node.size(); ++node) {
    node_of_pair[pair_of_node[node]] = int(node);
  }
  std::vector<RelativeLogScale> connected;
  for (RelativeLogScale ratio : ratios) {
    if (node_of_pair[ratio.node1] < 0) continue;
    ratio.node1 = node_of_pair[ratio.node1];
    ratio.node2 = node_of_pair[ratio.node2];
    connected.push_back(ratio);
  }
  std::vector<double> log_lengths(pair_of_node.size(), 0.0);
  if (!AverageScales(int(pair_of_node.size()),
                     connected,
                     /*fixed_node=*/0,
                     options,
                     &log_lengths)) {
    LOG(WARNING) << "Averaging of lengths failed: no pair is filtered by them";
    return lengths;
  }
  const double median = Median(log_lengths);
  for (size_t i = 0; i < pair_of_node.size(); ++i) {
    lengths[pair_of_node[i]] = std::exp(log_lengths[i] - median);
  }
  return lengths;
}

}  // namespace dgsfm
