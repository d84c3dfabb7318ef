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

  bool IsValid(std::string* error) const;
};

enum class DepthVerdict : uint8_t {
  INCONSISTENT = 0,  // fails a test in at least one direction
  CONSISTENT = 1,    // passes both tests in both directions
  UNTESTED = 2,      // a depth is unknown
};

// Transfers each match from image 1 to 2 and back with its depth (z-depth),
// and compares position and depth with the matched ones; a point that lands
// behind the other camera is inconsistent. matches.pixel_jacobians are not
// used.
std::vector<DepthVerdict> CheckDepthConsistency(
    const DepthMatches& matches,
    const Rigid3d& cam2_from_cam1,
    double scale_1_from_2,
    double focal_length1_px,
    double focal_length2_px,
    const DepthConsistencyOptions& options);

}  // namespace dgsfm
