// Confidences of depth as pictures, which depth_importer reads.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <string>

namespace dgsfm {

// Writes 255 times the values, which are in [0, 1], in grey of 8 bits; above 0
// at least 1. Throws std::runtime_error naming the file.
void WriteConfidencePicture(const std::string& path, const DepthMap& values);

}  // namespace dgsfm
