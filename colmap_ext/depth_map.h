// Depth maps as priors: the value type, how it is sampled at key points and
// how it is packed for the database. No files here (see depth_map_io.h).

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// What one unit of a depth map means. METRIC: metres (sensors, metric
// networks). RELATIVE: an unknown factor per image.
enum class DepthUnit { METRIC = 0, RELATIVE = 1 };

// Dense z-depth (third coordinate in the camera frame, not the length of the
// ray), height x width, row-major. Unknown depth is 0; every other value is
// finite and positive. The map covers the whole image, at any resolution:
// image position (u, v) [px, origin at the upper left corner, first pixel
// centre (0.5, 0.5)] of a W x H image lies at (u * width / W, v * height / H)
// of the map.
struct DepthMap {
  int width = 0;
  int height = 0;
  DepthUnit unit = DepthUnit::METRIC;
  std::vector<float> values;

  float At(int x, int y) const { return values[size_t(y) * width + x]; }
  // Share of pixels with known depth, in [0, 1].
  double Coverage() const;
};

struct DepthSamplingOptions {
  // Largest ratio of the largest to the smallest depth among the four
  // neighbours for them to count as one surface. Beyond it the sample lies on
  // a depth edge, where interpolation invents a point between two surfaces.
  double max_neighbor_ratio = 1.1;
  // Whether samples on a depth edge take the nearest neighbour's value
  // (otherwise they are unknown).
  bool keep_edges = true;

  bool IsValid(std::string* error) const;
};

// Depth at each key point [px of a image_width x image_height image], bilinear
// in log depth over the known ones of the four neighbours; 0 where unknown
// (outside the image, no known neighbour).
std::vector<float> SampleDepth(const DepthMap& depth_map,
                               const std::vector<Eigen::Vector2d>& points,
                               int image_width,
                               int image_height,
                               const DepthSamplingOptions& options);

// Half-precision floats, row-major, zlib-compressed; the inverse throws
// std::runtime_error if the blob is damaged or not width * height values.
// Values beyond half range saturate at 65504 on packing.
std::vector<uint8_t> CompressDepth(const DepthMap& depth_map);
DepthMap DecompressDepth(const std::vector<uint8_t>& blob,
                         int width,
                         int height,
                         DepthUnit unit);

}  // namespace dgsfm
