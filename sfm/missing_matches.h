// Evidence against pairs from matches that should be there and are not.

#pragma once

#include "sfm/pair_verification.h"

#include <map>
#include <vector>

namespace dgsfm {

// Images of look-alike places agree where the places do, and have no matches
// at all where they differ. With depth and the pose of a pair, features of one
// image that are matched elsewhere, and so can be found again, are looked for
// in the other: where both images see them from nearly the same direction and
// distance, a true pair matches about the same share of them everywhere, and a
// false one none in whole parts of the image.
class MissingMatches {
 public:
  // The references must outlive it and not change.
  MissingMatches(const Scene& scene,
                 const KeypointDepthMap& depths,
                 const PairGeometries& pairs);

  // How much better parts without any matches explain a valid pair than chance
  // does [nat], >= 0. Pairs without depth and scale say nothing (0).
  double EvidenceAgainst(colmap::image_pair_t pair_id) const;

 private:
  const Scene& scene_;
  const KeypointDepthMap& depths_;
  const PairGeometries& pairs_;
  // Of each feature of each image: how many valid pairs match it.
  std::map<colmap::image_t, std::vector<int>> num_matched_pairs_;
};

}  // namespace dgsfm
