// Depth maps as 3D Gaussian splatting's own loader reads them: a.png, 16 bits
// of inverse depth, for image a.jpg, and depth_params.json with the scale and
// offset of each: inverse depth = pixel / 65536 * scale + offset, 0 unknown.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <map>
#include <string>

namespace dgsfm {

constexpr char kSplattingParametersFile[] = "depth_params.json";

// The file of an image, in the same sub-folder.
std::string SplattingFileName(const std::string& image_name);

// Scale of each image by its name; 0 for those without a map.
using SplattingScales = std::map<std::string, double>;

// Throws std::runtime_error if two images would share a file.
void CheckSplattingNames(const SplattingScales& scales);

// The scale by which that inverse depth is the largest pixel.
double SplattingScale(double max_inverse_depth);

// Nearer depth saturates. Throws std::runtime_error naming the file.
void WriteSplattingPng(const std::string& path,
                       const DepthMap& depth_map,
                       double scale);

// Writes the file of the parameters. The scales are to be the same, because the
// loader distrusts images whose scale is far from the median. It wants a file
// of every image: those without a map get one unknown pixel. Throws
// std::runtime_error naming the file.
void WriteSplattingParameters(const std::string& folder,
                              const SplattingScales& scales);

}  // namespace dgsfm
