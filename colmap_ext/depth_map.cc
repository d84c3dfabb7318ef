#include "colmap_ext/depth_map.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <sstream>
#include <stdexcept>

#include <libdeflate.h>

namespace dgsfm {
namespace {

constexpr float kMaxHalf = 65504;
constexpr uint16_t kMaxHalfBits = 0x7bff;
constexpr uint16_t kMinHalfBits = 0x0001;
// Deflate cannot expand a byte into more than this (zlib's technical notes).
constexpr size_t kMaxDeflateRatio = 1032;

bool IsValidSize(int width, int height) {
  return width > 0 && height > 0 && width <= kMaxDepthMapSize &&
         height <= kMaxDepthMapSize;
}

void CheckIsWellFormed(const DepthMap& depth_map) {
  DGSFM_CHECK(IsValidSize(depth_map.width, depth_map.height))
      << "depth map of " << depth_map.width << " x " << depth_map.height;
  DGSFM_CHECK(depth_map.values.size() ==
              size_t(depth_map.width) * depth_map.height)
      << "depth map of " << depth_map.width << " x " << depth_map.height
      << " with " << depth_map.values.size() << " values";
}

uint16_t PackAnyHalf(float depth) {
  const uint16_t bits =
      Eigen::numext::bit_cast<uint16_t>(Eigen::half(std::min(depth, kMaxHalf)));
  // Known depth stays known even if it underflows.
  return depth > 0 ? std::max(bits, kMinHalfBits) : bits;
}

// Loops over whole numbers without branches, which compilers vectorize:
// positive floats are ordered as their bits are.
std::vector<uint16_t> PackHalfs(const std::vector<float>& depths) {
  const auto bits_of = [](float depth) {
    return Eigen::numext::bit_cast<int32_t>(depth);
  };
  constexpr int32_t kExponentOffset = (127 - 15) << 23;
  constexpr int32_t kMinNormalHalf = (127 - 14) << 23;
  constexpr int kShift = 23 - 10;
  int32_t min_bits = 0;
  int32_t max_bits = 0;
  int32_t min_known_bits = std::numeric_limits<int32_t>::max();
  for (const float depth : depths) {
    const int32_t bits = bits_of(depth);
    min_bits = std::min(min_bits, bits);
    max_bits = std::max(max_bits, bits);
    // 0 as the largest number.
    min_known_bits = std::min<int32_t>(
        min_known_bits, (static_cast<uint32_t>(bits) - 1) & 0x7fffffff);
  }
  DGSFM_CHECK(min_bits >= 0 &&
              max_bits <= bits_of(std::numeric_limits<float>::max()))
      << "a depth is negative or not finite";
  std::vector<uint16_t> halfs(depths.size());
  if (min_known_bits < kMinNormalHalf - 1 || max_bits > bits_of(kMaxHalf)) {
    std::transform(depths.begin(), depths.end(), halfs.begin(), PackAnyHalf);
    return halfs;
  }
  for (size_t i = 0; i < depths.size(); ++i) {
    const int32_t bits = bits_of(depths[i]);
    // As Eigen::half rounds: to the nearest, to the even one of two.
    const int32_t half =
        (bits - kExponentOffset + 0xfff + ((bits >> kShift) & 1)) >> kShift;
    halfs[i] = static_cast<uint16_t>(half & -static_cast<int32_t>(bits != 0));
  }
  return halfs;
}

// Maps small differences of either sign to small numbers: 0 -1 1 -2 2 ... to
// 0 1 2 3 4 ..., modulo 2^16.
uint16_t ZigZag(uint16_t difference) {
  return (difference << 1) ^ (difference & 0x8000 ? 0xffff : 0);
}

uint16_t UnZigZag(uint16_t code) {
  return (code >> 1) ^ (code & 1 ? 0xffff : 0);
}

// Position along one axis of the map and its two neighbouring pixels.
struct Neighbors {
  int lower;
  int upper;
  double upper_weight;
};

Neighbors FindNeighbors(double position, int size) {
  const double center = std::clamp(position - 0.5, 0.0, size - 1.0);
  const int lower = static_cast<int>(center);
  return {lower, std::min(lower + 1, size - 1), center - lower};
}

float SampleAt(const DepthMap& depth_map,
               const Neighbors& x,
               const Neighbors& y,
               const DepthSamplingOptions& options) {
  const std::array<float, 4> depths = {depth_map.At(x.lower, y.lower),
                                       depth_map.At(x.upper, y.lower),
                                       depth_map.At(x.lower, y.upper),
                                       depth_map.At(x.upper, y.upper)};
  const std::array<double, 4> weights = {
      (1 - x.upper_weight) * (1 - y.upper_weight),
      x.upper_weight * (1 - y.upper_weight),
      (1 - x.upper_weight) * y.upper_weight,
      x.upper_weight * y.upper_weight};

  float min_depth = std::numeric_limits<float>::max();
  float max_depth = 0;
  float nearest_depth = 0;
  double nearest_weight = 0;
  for (int i = 0; i < 4; ++i) {
    if (depths[i] <= 0 || weights[i] <= 0) continue;
    min_depth = std::min(min_depth, depths[i]);
    max_depth = std::max(max_depth, depths[i]);
    if (weights[i] > nearest_weight) {
      nearest_weight = weights[i];
      nearest_depth = depths[i];
    }
  }
  if (max_depth <= min_depth) return nearest_depth;
  if (max_depth > options.max_neighbor_ratio * min_depth) {
    return options.keep_edges ? nearest_depth : 0;
  }

  double sum_weights = 0;
  double sum_log_depths = 0;
  for (int i = 0; i < 4; ++i) {
    if (depths[i] <= 0) continue;
    sum_weights += weights[i];
    sum_log_depths += weights[i] * std::log(depths[i]);
  }
  return static_cast<float>(std::exp(sum_log_depths / sum_weights));
}

}  // namespace

double DepthMap::Coverage() const {
  if (values.empty()) return 0;
  const auto num_known = std::count_if(
      values.begin(), values.end(), [](float depth) { return depth > 0; });
  return static_cast<double>(num_known) / values.size();
}

bool DepthSamplingOptions::IsValid(std::string* error) const {
  if (max_neighbor_ratio >= 1) return true;
  if (error != nullptr) {
    std::ostringstream message;
    message << "max_neighbor_ratio is " << max_neighbor_ratio
            << " but must be at least 1";
    *error = message.str();
  }
  return false;
}

std::vector<float> SampleDepth(const DepthMap& depth_map,
                               const std::vector<Eigen::Vector2d>& points,
                               int image_width,
                               int image_height,
                               const DepthSamplingOptions& options) {
  CheckIsWellFormed(depth_map);
  DGSFM_CHECK(image_width > 0 && image_height > 0)
      << "image of " << image_width << " x " << image_height;
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;

  const double x_scale = static_cast<double>(depth_map.width) / image_width;
  const double y_scale = static_cast<double>(depth_map.height) / image_height;
  std::vector<float> samples;
  samples.reserve(points.size());
  for (const Eigen::Vector2d& point : points) {
    // Written so that NaN is outside.
    const bool is_inside = point.x() >= 0 && point.x() <= image_width &&
                           point.y() >= 0 && point.y() <= image_height;
    samples.push_back(
        is_inside
            ? SampleAt(depth_map,
                       FindNeighbors(point.x() * x_scale, depth_map.width),
                       FindNeighbors(point.y() * y_scale, depth_map.height),
                       options)
            : 0);
  }
  return samples;
}

CompressedDepthMap CompressDepth(const DepthMap& depth_map) {
  CheckIsWellFormed(depth_map);
  const size_t num_values = depth_map.values.size();
  std::vector<uint8_t> planes(2 * num_values);
  const std::vector<uint16_t> bits = PackHalfs(depth_map.values);
  uint8_t* low_bytes = planes.data();
  uint8_t* high_bytes = planes.data() + num_values;
  for (size_t i = 0; i < num_values; ++i) {
    const uint16_t previous = i == 0 ? 0 : bits[i - 1];
    const uint16_t code = ZigZag(bits[i] - previous);
    low_bytes[i] = code & 0xff;
    high_bytes[i] = code >> 8;
  }

  // After the differences little is left to find besides the entropy coding.
  constexpr int kFastest = 1;
  const std::unique_ptr<libdeflate_compressor,
                        decltype(&libdeflate_free_compressor)>
      compressor(libdeflate_alloc_compressor(kFastest),
                 &libdeflate_free_compressor);
  if (compressor == nullptr) throw std::bad_alloc();
  CompressedDepthMap compressed = {
      depth_map.width, depth_map.height, depth_map.unit, {}};
  std::vector<uint8_t> bytes(
      libdeflate_zlib_compress_bound(compressor.get(), planes.size()));
  bytes.resize(libdeflate_zlib_compress(compressor.get(),
                                        planes.data(),
                                        planes.size(),
                                        bytes.data(),
                                        bytes.size()));
  DGSFM_CHECK(!bytes.empty());
  // Without the room that was not needed.
  compressed.bytes.assign(bytes.begin(), bytes.end());
  return compressed;
}

DepthMap DecompressDepth(const CompressedDepthMap& compressed) {
  const int width = compressed.width;
  const int height = compressed.height;
  const std::vector<uint8_t>& bytes = compressed.bytes;
  const auto fail = [&](const std::string& reason) {
    throw std::runtime_error("stored depth map of " + std::to_string(width) +
                             " x " + std::to_string(height) + ": " + reason);
  };
  if (!IsValidSize(width, height)) {
    fail("the size is not in 1 to " + std::to_string(kMaxDepthMapSize));
  }
  const size_t num_values = size_t(width) * height;
  // Before allocating what a damaged size asks for.
  if (num_values / kMaxDeflateRatio > bytes.size()) fail("too little data");

  std::vector<uint8_t> planes(2 * num_values);
  const std::unique_ptr<libdeflate_decompressor,
                        decltype(&libdeflate_free_decompressor)>
      decompressor(libdeflate_alloc_decompressor(),
                   &libdeflate_free_decompressor);
  if (decompressor == nullptr) throw std::bad_alloc();
  size_t num_read = 0;
  size_t num_bytes = 0;
  const libdeflate_result result =
      libdeflate_zlib_decompress_ex(decompressor.get(),
                                    bytes.data(),
                                    bytes.size(),
                                    planes.data(),
                                    planes.size(),
                                    &num_read,
                                    &num_bytes);
  if (result == LIBDEFLATE_INSUFFICIENT_SPACE) fail("too many values");
  if (result != LIBDEFLATE_SUCCESS) fail("the data are damaged");
  if (num_bytes != planes.size()) fail("too few values");
  if (num_read != bytes.size()) fail("data after its end");

  DepthMap depth_map = {
      width, height, compressed.unit, std::vector<float>(num_values)};
  uint16_t bits = 0;
  for (size_t i = 0; i < num_values; ++i) {
    bits += UnZigZag(planes[i] | planes[num_values + i] << 8);
    if (bits > kMaxHalfBits) fail("a depth is negative or not finite");
    depth_map.values[i] = Eigen::numext::bit_cast<Eigen::half>(bits);
  }
  return depth_map;
}

}  // namespace dgsfm
