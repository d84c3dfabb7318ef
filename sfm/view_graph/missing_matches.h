// Evidence against pairs from matches that should be there and are not.

#pragma once

#include "sfm/verification/pair_verification.h"

#include <map>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Images of look-alike places agree where the places do, and have no matches
// at all where they differ. With depth and the pose of a pair, features of one
// image that are matched elsewhere, and so can be found again, are looked for
// in the other: where both images see them from nearly the same direction and
// distance, a true pair matches about the same share of them everywhere, and a
// false one none in whole parts of the image.
class MissingMatches {
 public:
  // Key point of an image, with depth and matched by a valid pair.
  struct Feature {
    colmap::point2D_t point2D_idx = 0;
    int num_matched_pairs = 0;
    // In units of the depth map.
    Eigen::Vector3d point_in_cam = Eigen::Vector3d::Zero();
  };

  // The scene and the pairs must outlive it and not change.
  MissingMatches(const Scene& scene,
                 const KeypointDepthMap& depths,
                 const PairGeometries& pairs);

  // Log-likelihood ratio [nat] of "the images show different places" to "the
  // parts without matches are accidental", at least 0; 0 for pairs without
  // depth and scale.
  double EvidenceAgainst(colmap::image_pair_t pair_id) const;

 private:
  const Scene& scene_;
  const PairGeometries& pairs_;
  std::map<colmap::image_t, std::vector<Feature>> features_;
};

}  // namespace dgsfm
