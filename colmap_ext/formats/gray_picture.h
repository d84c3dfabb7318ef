// Pictures that hold numbers as grey.

#pragma once

#include "colmap_ext/formats/depth_file_formats.h"

#include <string>

namespace dgsfm::internal {

// A PNG of 8 or 16 bits in grey, with or without a palette or transparency, or
// in colours whose channels are equal everywhere. Others, as those of
// colour-mapped depth, are refused with the remedy.
struct GrayPicture {
  DepthGrid grid;
  float max_value = 255;  // of its number of bits
};
GrayPicture ParseGrayPicture(std::string bytes);

}  // namespace dgsfm::internal
