#include "sfm/view_graph/translation_filter.h"

#include "estimators/averaging/graph.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/median.h"
#include "sfm/view_graph/pair_views.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Relative error of a pair's translation, of the order of a network's [1].
// Short baselines err as the median one does: what a false pair of look-alike
// places claims is often that it has none.
constexpr double kTranslationStddevRatio = 0.1;

// Ratios of a pair to stronger ones at each of its images, at most.
constexpr int kMaxNumRatios = 4;

// A pair and what it claims of the centres of its images [world].
struct PairTranslation {
  colmap::image_t image_id1 = 0;
  colmap::image_t image_id2 = 0;
  PairGeometry* pair = nullptr;
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

// The difference of the centres, at a length of `unit` per translation.
PairTranslation TranslationOf(
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations,
    const IndexedPair& indexed,
    double unit) {
  return {index.IdOf(indexed.image1),
          index.IdOf(indexed.image2),
          indexed.pair,
          -unit * (cam_from_world_rotations[indexed.image2].conjugate() *
                   indexed.pair->cam2_from_cam1.translation)};
}

// Translations of the largest part that they connect, between the images of the
// index of this part.
std::vector<RelativeTranslation> ConnectTranslations(
    const ImageIndex& part,
    const std::vector<PairTranslation>& pair_translations) {
  std::vector<RelativeTranslation> translations;
  std::vector<double> lengths;
  for (const PairTranslation& pair_translation : pair_translations) {
    RelativeTranslation& relative = translations.emplace_back();
    relative.node1 = part.Of(pair_translation.image_id1);
    relative.node2 = part.Of(pair_translation.image_id2);
    relative.translation = pair_translation.translation;
    lengths.push_back(relative.translation.norm());
  }
  const double median = std::max(Median(lengths), 1e-12);
  for (RelativeTranslation& relative : translations) {
    relative.stddev =
        kTranslationStddevRatio * std::max(relative.translation.norm(), median);
  }
  return translations;
}

LengthFilterResult Filter(const ComponentAveragingOptions& options,
                          const ImageIndex& part,
                          const std::vector<PairTranslation>& pairs) {
  LengthFilterResult result;
  if (pairs.empty()) return result;
  const std::vector<RelativeTranslation> translations =
      ConnectTranslations(part, pairs);
  std::vector<Eigen::Vector3d> centers;
  if (!AverageTranslations(part.Size(),
                           translations,
                           /*fixed_node=*/0,
                           options.translation_averaging,
                           &centers)) {
    LOG(WARNING) << "Translation averaging failed: no pair is filtered by it";
    return result;
  }
  const std::vector<double> errors = TranslationErrors(translations, centers);
  const double max_error =
      std::max(options.max_translation_error_ratio / kTranslationStddevRatio,
               options.max_translation_error_factor * Median(errors));
  for (size_t i = 0; i < errors.size(); ++i) {
    if (errors[i] <= max_error) continue;
    pairs[i].pair->Judge(PairStage::TRANSLATION_AVERAGING,
                         PairStatus::TRANSLATION_OUTLIER);
    ++result.num_pairs_filtered;
  }
  for (int i = 0; i < part.Size(); ++i) {
    result.centers[part.IdOf(i)] = centers[i];
  }
  return result;
}

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

// Lengths of the translations of the pairs in a common unit, by index into
// `pairs`. Each pair triangulates its inliers with a baseline of length one; a
// key point that two pairs triangulate has one depth, which gives the ratio of
// their lengths. A pair that claims that its images did not move has a
// length close to zero. Only pairs of the largest part that such ratios connect
// have a length; none has if the averaging fails.
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

}  // namespace

size_t FilterByTranslation(
    const ComponentAveragingOptions& options,
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations,
    const ImageScales& scales,
    PairGeometries* pairs) {
  std::vector<colmap::image_t> image_ids;
  for (const auto& [image_id, scale] : scales) image_ids.push_back(image_id);
  const ImageIndex scaled_index(image_ids);
  std::vector<PairTranslation> translations;
  for (const IndexedPair& indexed : ValidPairs(index, pairs)) {
    const auto scale = scales.find(index.IdOf(indexed.image1));
    if (!indexed.pair->has_scale || scale == scales.end() ||
        scales.count(index.IdOf(indexed.image2)) == 0) {
      continue;
    }
    translations.push_back(
        TranslationOf(index, cam_from_world_rotations, indexed, scale->second));
  }
  return Filter(options, scaled_index, translations).num_pairs_filtered;
}

LengthFilterResult FilterByLength(
    const ComponentAveragingOptions& options,
    const Scene& scene,
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations,
    int num_threads,
    PairGeometries* pairs) {
  const std::vector<IndexedPair> valid_pairs = ValidPairs(index, pairs);
  const std::map<int, double> lengths = LengthsOfPairs(
      scene, index, valid_pairs, options.scale_averaging, num_threads);
  std::vector<GraphEdge> edges;
  for (const auto& [i, length] : lengths) {
    edges.emplace_back(valid_pairs[i].image1, valid_pairs[i].image2);
  }
  std::vector<colmap::image_t> image_ids;
  for (const int image : LargestComponent(index.Size(), edges)) {
    image_ids.push_back(index.IdOf(image));
  }
  const ImageIndex part(image_ids);
  std::vector<PairTranslation> translations;
  for (const auto& [i, length] : lengths) {
    const IndexedPair& indexed = valid_pairs[i];
    if (part.Of(index.IdOf(indexed.image1)) < 0) continue;
    const double unit =
        length / indexed.pair->cam2_from_cam1.translation.norm();
    translations.push_back(
        TranslationOf(index, cam_from_world_rotations, indexed, unit));
  }
  return Filter(options, part, translations);
}

}  // namespace dgsfm
