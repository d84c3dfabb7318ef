// Estimates and verifies the depth-aware geometry of image pairs.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/pair_geometry.h"
#include "colmap_ext/scene.h"
#include "estimators/two_view/depth_consistency.h"
#include "estimators/two_view/two_view_geometry_depth.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

using KeypointDepthMap = std::map<colmap::image_t, KeypointDepths>;
using PairGeometries = std::map<colmap::image_pair_t, PairGeometry>;

struct PairVerificationOptions {
  TwoViewDepthOptions two_view;
  DepthConsistencyOptions depth_consistency;
  // Whether matches that contradict the depth maps are removed.
  bool filter_depth = true;
  // The depth error that a match may show is at least this many standard
  // deviations of the pair's own depth noise: maps that are bad everywhere are
  // no evidence against single matches. 0 = fixed thresholds, as in the paper.
  double depth_noise_factor = 3.0;
  // A pair needs this many matches that agree with its pose, and this share of
  // its matches (paper: 15 and 0.25) [1].
  int min_num_inliers = 15;
  double min_inlier_ratio = 0.25;
  // Mixed into the seed of every pair.
  int random_seed = 0;
  // Threads over pairs, and of all stages of the mapper; -1 = all cores.
  // Results do not depend on it.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
};

// An image of a pair: with its key points, and their depths or null.
struct PairImage {
  const colmap::Image& image;
  const colmap::Camera& camera;
  const KeypointDepths* depths = nullptr;
  // Prior of the focal length, where the camera is not calibrated.
  FocalPrior focal_prior;
};

// `depths` may be null.
PairImage CreatePairImage(const Scene& scene,
                          const colmap::Image& image,
                          const KeypointDepths* depths);
PairImage CreatePairImage(const Scene& scene,
                          const KeypointDepthMap& depths,
                          colmap::image_t image_id);

// Verifies one pair. `matches` refer to key points of the images in this
// order. A camera with a prior focal length counts as calibrated, with its
// distortion, and thresholds hold in pixels of its image; matches where the
// model has no ray are no inliers. Of other cameras the distortion is unknown,
// and so is the focal length, for which that of EXIF data, or else of the depth
// model, is a soft prior. Images without an entry in `depths` have no depth.
// With the rotation of image 2 relative to image 1 by other pairs, only poses
// near it are searched for. The result depends on nothing else: neither on
// other pairs nor on the order of pairs.
PairGeometry VerifyPair(
    const PairImage& image1,
    const PairImage& image2,
    const colmap::FeatureMatches& matches,
    const PairVerificationOptions& options,
    const std::optional<Eigen::Quaterniond>& rotation = std::nullopt);
PairGeometry VerifyPair(const Scene& scene,
                        const KeypointDepthMap& depths,
                        colmap::image_pair_t pair_id,
                        const colmap::FeatureMatches& matches,
                        const PairVerificationOptions& options);

// Sorts pairs by their matches, longest first, so that no thread starts a long
// one when the others end.
void SortLongestFirst(const PairGeometries& pairs,
                      std::vector<colmap::image_pair_t>* pair_ids);

// Verifies all pairs of scene.matches with at least min_num_inliers matches,
// longest first; pairs with fewer are listed as TOO_FEW_MATCHES.
PairGeometries VerifyPairs(const Scene& scene,
                           const KeypointDepthMap& depths,
                           const PairVerificationOptions& options);

// As above, with these matches instead of the scene's.
PairGeometries VerifyPairs(
    const Scene& scene,
    const std::map<colmap::image_pair_t, colmap::FeatureMatches>& matches,
    const KeypointDepthMap& depths,
    const PairVerificationOptions& options);

}  // namespace dgsfm
