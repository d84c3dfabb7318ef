// Which matches of a pair the depth maps confirm (DGSfM Sec. 3.2, "Scaled
// Depth Consistency Filtering").

#pragma once

#include "colmap_ext/rigid3.h"
#include "estimators/two_view/two_view_geometry_depth.h"

#include <cstdint>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthConsistencyOptions {
  // Paper: tau_pi [px] and tau_d [1, relative depth error].
  double max_reprojection_error_px = 12.0;
  double max_depth_error_ratio = 0.3;
  // Whether a match may be off by what a depth error up to
  // max_depth_error_ratio explains: the position is then compared with the
  // segment that the point covers as its depth varies by that ratio. The paper
  // compares with the point itself, so that at wide baselines, where some per
  // cent of depth move the point by tens of pixels, hardly a match passes.
  bool tolerate_depth_error = true;
  // Noise of log depth of either map [1]: if positive, matches are tested
  // against the covariance of their errors (pixel noise stddev_px, three
  // standard deviations) instead of the bounds above, and disagreeing depths
  // are told from impossible ones by their signs.
  double log_depth_stddev = 0;
  double stddev_px = 1.0;

  bool IsValid(std::string* error) const;
};

enum class DepthVerdict : uint8_t {
  INCONSISTENT = 0,  // fails a test in at least one direction
  CONSISTENT = 1,    // passes both tests in both directions
  UNTESTED = 2,      // a depth is unknown
  // With log_depth_stddev only: position and epipolar line agree, but one map
  // shows a surface in front of the other's point, as at an occlusion or where
  // a map is blurred over a depth edge. The match itself may be right.
  OCCLUDED = 3,
};

// Transfers each match from image 1 to 2 and back with its depth (z-depth),
// and compares position and depth with the matched ones; a point that lands
// behind the other camera is inconsistent. With log_depth_stddev, so is one
// that either view sees through: both transferred points lie in front of the
// surface that the other map shows. matches.pixel_jacobians are not used.
std::vector<DepthVerdict> CheckDepthConsistency(
    const DepthMatches& matches,
    const Rigid3d& cam2_from_cam1,
    double scale_1_from_2,
    double focal_length1_px,
    double focal_length2_px,
    const DepthConsistencyOptions& options);

}  // namespace dgsfm
