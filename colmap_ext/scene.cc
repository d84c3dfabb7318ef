#include "colmap_ext/scene.h"

#include "colmap_ext/check.h"

#include <algorithm>

namespace dgsfm {

colmap::FeatureMatches MatchesOf(const Scene& scene,
                                 colmap::image_pair_t pair_id) {
  const colmap::FeatureMatches& matches = scene.matches.at(pair_id);
  return matches.empty() && scene.match_source
             ? scene.match_source->Read(pair_id)
             : matches;
}

std::pair<colmap::image_t, colmap::image_t> ImageIdsOfPair(
    colmap::image_pair_t pair_id) {
  DGSFM_CHECK(pair_id < kMaxNumImages * kMaxNumImages) << pair_id;
  return {static_cast<colmap::image_t>(pair_id / kMaxNumImages),
          static_cast<colmap::image_t>(pair_id % kMaxNumImages)};
}

colmap::image_pair_t PairIdOfImages(colmap::image_t image_id1,
                                    colmap::image_t image_id2) {
  DGSFM_CHECK(image_id1 < kMaxNumImages) << image_id1;
  DGSFM_CHECK(image_id2 < kMaxNumImages) << image_id2;
  return kMaxNumImages * std::min(image_id1, image_id2) +
         std::max(image_id1, image_id2);
}

}  // namespace dgsfm
