#include "sfm/view_graph/translation_filter.h"

#include "estimators/averaging/graph.h"
#include "estimators/median.h"
#include "sfm/view_graph/pair_lengths.h"

#include <algorithm>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Relative error of a pair's translation, of the order of a network's [1].
// Short baselines err as the median one does: what a false pair of look-alike
// places claims is often that it has none.
constexpr double kTranslationStddevRatio = 0.1;

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
