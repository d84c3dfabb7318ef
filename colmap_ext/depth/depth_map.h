// Depth maps as priors: the value type, how it is sampled at key points and
// how it is packed for the database. No files here (see depth_map_io.h).

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// What one unit of a depth map means. METRIC: metres (sensors, metric
// networks). RELATIVE: an unknown factor per image. AFFINE_DISPARITY and
// AFFINE_DEPTH: values are a / z + b and a z + b of depth z, with a > 0 and b
// unknown per image, of any sign, of which 0 alone is unknown (affine_depth.h).
// Databases store the numbers.
enum class DepthUnit {
  METRIC = 0,
  RELATIVE = 1,
  AFFINE_DISPARITY = 2,
  AFFINE_DEPTH = 3,
};

// Largest width and height of a depth map: bounds what a damaged file or
// database can make us allocate.
constexpr int kMaxDepthMapSize = 16384;

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

// Depth [unit of the image's map] at each key point of an image; 0 unknown.
struct KeypointDepths {
  DepthUnit unit = DepthUnit::METRIC;
  std::vector<float> depths;
  // Focal length of the image by the depth model [px of the image]; 0 unknown.
  double focal_length_px = 0;
  // Tells whether the depth came from the same file by the same options; 0
  // unknown.
  uint64_t source_fingerprint = 0;
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

// Depth at each point [px of a image_width x image_height image], bilinear in
// log depth over the known ones of the four neighbours, the border pixels
// extended to the border of the image; 0 where unknown (point outside the
// image or not finite, no known neighbour of positive weight).
std::vector<float> SampleDepth(const DepthMap& depth_map,
                               const std::vector<Eigen::Vector2d>& points,
                               int image_width,
                               int image_height,
                               const DepthSamplingOptions& options);

// Depths that CompressDepth() keeps to half precision.
constexpr float kMinStorableDepth = 1.0f / (1 << 14);
constexpr float kMaxStorableDepth = 65504;

// A depth map as the database keeps it.
struct CompressedDepthMap {
  int width = 0;
  int height = 0;
  DepthUnit unit = DepthUnit::METRIC;
  std::vector<uint8_t> bytes;
};

// Packs the values as half-precision floats.
// Before zlib, per value in row-major order: its 16 bits as an unsigned number
// minus those of the value before it (0 before the first) modulo 2^16, taken
// as a signed number d and mapped to code = 2 d (d >= 0) or -2 d - 1 (d < 0);
// then the low bytes of all codes followed by their high bytes. Depth beyond
// half range saturates at 65504, depth below it at 2^-24, so that known depth
// stays known.
CompressedDepthMap CompressDepth(const DepthMap& depth_map);
// Throws std::runtime_error if the bytes are damaged or not width x height
// values.
DepthMap DecompressDepth(const CompressedDepthMap& compressed);

}  // namespace dgsfm
