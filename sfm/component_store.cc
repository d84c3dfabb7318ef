#include "sfm/component_store.h"

namespace dgsfm {

std::map<colmap::image_pair_t, PairOutcome> OutcomesOf(
    const ImageIds& image_ids, const PairGeometries& pairs) {
  const ImageIndex index(image_ids);
  std::map<colmap::image_pair_t, PairOutcome> outcomes;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (index.Of(image_id1) < 0 || index.Of(image_id2) < 0) continue;
    outcomes.emplace_hint(
        outcomes.end(),
        pair_id,
        PairOutcome{pair.status,
                    pair.verdicts,
                    pair.degeneracies,
                    pair.has_scale,
                    pair.num_matches,
                    pair.NumInliers(),
                    pair.inlier_matches.size() == pair.NumInliers()});
  }
  return outcomes;
}

void ApplyOutcomes(const std::map<colmap::image_pair_t, PairOutcome>& outcomes,
                   PairGeometries* pairs) {
  for (const auto& [pair_id, outcome] : outcomes) {
    PairGeometry& pair = pairs->at(pair_id);
    pair.status = outcome.status;
    pair.verdicts = outcome.verdicts;
    pair.degeneracies = outcome.degeneracies;
    pair.num_matches = outcome.num_matches;
    if (pair.has_scale && !outcome.has_scale) pair.DropScale();
    if (!outcome.has_inliers || outcome.num_inliers != pair.NumInliers()) {
      pair.ReleaseInliers();
      pair.num_released_inliers = outcome.num_inliers;
    }
  }
}

}  // namespace dgsfm
