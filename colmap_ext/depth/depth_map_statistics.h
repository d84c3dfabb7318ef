// What the values of a map look like, whatever they are said to be.

#pragma once

#include "colmap_ext/depth/depth_map.h"

namespace dgsfm {

struct DepthMapStatistics {
  double min = 0;
  double median = 0;
  double max = 0;
  // Share of the known pixels that have exactly the largest value [1]; 0 of
  // maps with fewer than 100 of them.
  double share_at_max = 0;
  // Whether all values are whole numbers.
  bool are_whole = false;
  // Whether 90 % of at least 100 values are the same within 0.1 %.
  bool is_constant = false;
  // Median of the lowest third of the image over that of the uppermost; 1 where
  // one of them is unknown or not positive. Depth is below 1 in most pictures,
  // since the ground is near, disparity above.
  double lower_to_upper = 1;
};

// Measures the known values; the result is all zero if there are none.
DepthMapStatistics MeasureDepthMap(const DepthMap& depth_map);

}  // namespace dgsfm
