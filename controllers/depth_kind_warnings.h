// Maps that look like another kind of depth than they are said to be.

#pragma once

#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/depth/depth_map_statistics.h"

#include <string>
#include <vector>

namespace dgsfm {

// What looks wrong with one map.
enum class DepthOddity {
  MILLIMETRES,  // whole numbers, of a median that no camera sees in metres
  PICTURE,      // whole numbers of 8 bits
  CONSTANT,     // one value everywhere
  SKY_AT_MAX,   // many pixels with exactly the largest value
};

std::vector<DepthOddity> FindOddities(const DepthMapStatistics& statistics,
                                      const DepthReadOptions& options);

// What is looked at of each map.
struct DepthKindSample {
  std::string name;  // of the image
  std::vector<DepthOddity> oddities;
  double lower_to_upper = 1;  // see DepthMapStatistics
};

// One line of warning for each oddity, with the number of maps, an example and
// the option that fits; and one if the maps as a whole look like disparity
// taken for depth or the reverse.
std::string DepthKindWarnings(const std::vector<DepthKindSample>& samples,
                              DepthType type);

// A line of warning if most images have no depth map, otherwise nothing.
std::string MissingMapsWarning(size_t num_missing, size_t num_images);

}  // namespace dgsfm
