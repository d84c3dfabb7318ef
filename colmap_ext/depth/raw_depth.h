// What depth files hold, before it is known what the numbers mean.

#pragma once

#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/formats/depth_file_formats.h"

#include <optional>
#include <string>

namespace dgsfm::internal {

// All that files hold about an image, in the frame of the depth model's input.
struct RawDepth {
  DepthGrid depth;
  std::optional<DepthGrid> mask;
  std::optional<DepthGrid> confidence;
  std::optional<DepthGrid> uncertainty;
  std::optional<NumberArray> intrinsics;
};

// "width x height".
std::string FormatSize(size_t width, size_t height);

// Reads a file; pictures only for relative types. Throws std::runtime_error
// with the reason.
RawDepth ReadRawDepth(const DepthFile& file, DepthType type);

// Makes depth 0 where mask, confidence or uncertainty exclude it. Throws if
// they have another size than depth.
void ApplyConfidence(const DepthReadOptions& options, RawDepth* raw);

// The map of the image as stored from that of the image as displayed.
DepthGrid TurnBack(const DepthGrid& grid, int orientation);

}  // namespace dgsfm::internal
