// The file formats that hold depth, as plain grids of numbers. Callers want
// depth_map_io.h, which knows what the numbers mean and names the file in
// errors.
//
// Readers throw std::runtime_error with the reason if the content is damaged or
// not supported. They allocate no more than kMaxDepthMapSize^2 values, and for
// compressed formats no more than the size of the file can expand to.

#pragma once

#include "colmap_ext/depth_map.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm::internal {

// The largest grid of doubles with its header.
constexpr uint64_t kMaxFileBytes =
    8 * uint64_t(kMaxDepthMapSize) * kMaxDepthMapSize + (1 << 20);
// Deflate cannot expand a byte into more than this (zlib's technical notes).
constexpr uint64_t kMaxDeflateRatio = 1032;

// Numbers as they are in a file, row-major from the top, NaN and infinity
// included.
struct DepthGrid {
  int width = 0;
  int height = 0;
  std::vector<float> values;
};

// Throws unless 1 <= width, height <= kMaxDepthMapSize.
void CheckGridSize(uint64_t width, uint64_t height);

// NumPy array (format versions 1 to 3) of floats of 2, 4 or 8 bytes or integers
// of 1 to 8 bytes, either byte order, C or Fortran order. The shape is height x
// width after removing leading, then trailing, dimensions of size 1.
DepthGrid ParseNpy(const std::vector<uint8_t>& bytes);

// An array of a NumPy archive, stored or deflated; nothing if there is none of
// that name.
std::optional<DepthGrid> ReadNpz(const std::string& path,
                                 const std::string& array_name);

// Portable float map of one channel ("Pf"). Byte order by the sign of its
// scale, whose size is ignored, as every reader does.
DepthGrid ParsePfm(const std::vector<uint8_t>& bytes);

// Grayscale PNG of 16 bits, which marks unknown depth by 0 or 65535: both are 0
// in the grid.
DepthGrid ParsePng(const std::vector<uint8_t>& bytes);

// Little endian, C order, format version 1.
std::vector<uint8_t> FormatNpyHalf(const DepthGrid& grid);
std::vector<uint8_t> FormatNpyFloat(const DepthGrid& grid);

// Row-major values from the top. Throws with the path and libpng's message.
void WritePng16(const std::string& path,
                int width,
                int height,
                const std::vector<uint16_t>& values);

}  // namespace dgsfm::internal
