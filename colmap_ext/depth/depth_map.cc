#include "colmap_ext/depth/depth_map.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <sstream>
#include <stdexcept>

#include <isa-l/igzip_lib.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace dgsfm {
namespace {

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
  const uint16_t bits = Eigen::numext::bit_cast<uint16_t>(
      Eigen::half(std::min(depth, kMaxStorableDepth)));
  // Known depth stays known even if it underflows.
  return depth > 0 ? std::max(bits, kMinHalfBits) : bits;
}

int32_t BitsOf(float depth) { return Eigen::numext::bit_cast<int32_t>(depth); }

// What the loops below do to halfs of the usual range; they have no branches,
// so that compilers vectorize them. Positive floats are ordered as their bits
// are.
uint16_t PackNormalHalf(float depth) {
  constexpr int32_t kExponentOffset = (127 - 15) << 23;
  constexpr int kShift = 23 - 10;
  const int32_t bits = BitsOf(depth);
  // As Eigen::half rounds: to the nearest, to the even one of two.
  const int32_t half =
      (bits - kExponentOffset + 0xfff + ((bits >> kShift) & 1)) >> kShift;
  return static_cast<uint16_t>(half & -static_cast<int32_t>(bits != 0));
}

// Whether PackNormalHalf() does for all. Throws for what is no depth.
bool AreNormalHalfs(const float* depths, size_t size) {
  int32_t min_bits = 0;
  int32_t max_bits = 0;
  int32_t min_known_bits = std::numeric_limits<int32_t>::max();
  for (size_t i = 0; i < size; ++i) {
    const int32_t bits = BitsOf(depths[i]);
    min_bits = std::min(min_bits, bits);
    max_bits = std::max(max_bits, bits);
    // 0 as the largest number.
    min_known_bits = std::min<int32_t>(
        min_known_bits, (static_cast<uint32_t>(bits) - 1) & 0x7fffffff);
  }
  DGSFM_CHECK(min_bits >= 0 &&
              max_bits <= BitsOf(std::numeric_limits<float>::max()))
      << "a depth is negative or not finite";
  return min_known_bits >= BitsOf(kMinStorableDepth) - 1 &&
         max_bits <= BitsOf(kMaxStorableDepth);
}

// Maps small differences of either sign to small numbers: 0 -1 1 -2 2 ... to
// 0 1 2 3 4 ..., modulo 2^16.
uint16_t ZigZag(uint16_t difference) {
  return (difference << 1) ^ (difference & 0x8000 ? 0xffff : 0);
}

uint16_t UnZigZag(uint16_t code) {
  return (code >> 1) ^ (code & 1 ? 0xffff : 0);
}

// The two planes of bytes that CompressDepth() documents, in blocks that fit
// into the fastest memory.
void WritePlanes(const std::vector<float>& depths, uint8_t* planes) {
  constexpr size_t kBlockSize = 2048;
  // One number of the block before comes first.
  std::array<uint16_t, kBlockSize + 1> halfs = {};
  for (size_t begin = 0; begin < depths.size(); begin += kBlockSize) {
    const size_t size = std::min(kBlockSize, depths.size() - begin);
    const float* block = depths.data() + begin;
    if (AreNormalHalfs(block, size)) {
      std::transform(block, block + size, &halfs[1], PackNormalHalf);
    } else {
      std::transform(block, block + size, &halfs[1], PackAnyHalf);
    }
    uint8_t* low_bytes = planes + begin;
    uint8_t* high_bytes = low_bytes + depths.size();
    for (size_t i = 0; i < size; ++i) {
      const uint16_t code = ZigZag(halfs[i + 1] - halfs[i]);
      low_bytes[i] = code & 0xff;
      high_bytes[i] = code >> 8;
    }
    halfs[0] = halfs[size];
  }
}

#if defined(__x86_64__)
__attribute__((target("avx"))) void ZeroUpperHalves() { _mm256_zeroupper(); }

// ISA-L leaves the upper halves of the registers of AVX in use, with which all
// SSE instructions of the thread take several times as long from then on.
void CleanUpAfterIsal() {
  if (__builtin_cpu_supports("avx")) ZeroUpperHalves();
}
#else
void CleanUpAfterIsal() {}
#endif

// One zlib stream.
std::vector<uint8_t> Deflate(const uint8_t* data, size_t size) {
  // After the differences little is left to find besides the entropy coding.
  constexpr int kLevel = 1;
  // What does not compress is stored in blocks of 64 kB.
  const size_t max_size = size + size / 64 + 4096;
  // Without writing zeros first.
  const std::unique_ptr<uint8_t[]> bytes(new uint8_t[max_size]);
  const std::unique_ptr<uint8_t[]> tables(new uint8_t[ISAL_DEF_LVL1_DEFAULT]);
  isal_zstream stream;
  isal_deflate_init(&stream);
  stream.gzip_flag = IGZIP_ZLIB;
  stream.level = kLevel;
  stream.level_buf = tables.get();
  stream.level_buf_size = ISAL_DEF_LVL1_DEFAULT;
  stream.end_of_stream = 1;
  stream.next_in = const_cast<uint8_t*>(data);
  stream.avail_in = static_cast<uint32_t>(size);
  stream.next_out = bytes.get();
  stream.avail_out = static_cast<uint32_t>(max_size);
  const int result = isal_deflate(&stream);
  CleanUpAfterIsal();
  DGSFM_CHECK(result == COMP_OK && stream.internal_state.state == ZSTATE_END)
      << "deflate: " << result;
  return {bytes.get(), bytes.get() + stream.total_out};
}

// Why the bytes are not exactly one zlib stream of `size` bytes of data;
// nullptr if they are.
const char* Inflate(const std::vector<uint8_t>& bytes,
                    size_t size,
                    uint8_t* data) {
  inflate_state state;
  isal_inflate_init(&state);
  state.crc_flag = ISAL_ZLIB;
  state.next_in = const_cast<uint8_t*>(bytes.data());
  state.avail_in = static_cast<uint32_t>(bytes.size());
  state.next_out = data;
  state.avail_out = static_cast<uint32_t>(size);
  const int result = isal_inflate_stateless(&state);
  CleanUpAfterIsal();
  if (result == ISAL_OUT_OVERFLOW) return "too many values";
  if (result != ISAL_DECOMP_OK) return "the data are damaged";
  if (state.total_out != size) return "too few values";
  if (state.avail_in != 0) return "data after its end";
  return nullptr;
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
  const size_t size = 2 * depth_map.values.size();
  const std::unique_ptr<uint8_t[]> planes(new uint8_t[size]);
  WritePlanes(depth_map.values, planes.get());
  return {depth_map.width,
          depth_map.height,
          depth_map.unit,
          Deflate(planes.get(), size)};
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

  const std::unique_ptr<uint8_t[]> planes(new uint8_t[2 * num_values]);
  if (const char* error = Inflate(bytes, 2 * num_values, planes.get())) {
    fail(error);
  }

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
