// The file formats that hold depth, as plain grids of numbers. depth_map_io.h
// is the interface for callers: it interprets the numbers and names the file
// in errors.
//
// Readers throw std::runtime_error with the reason if the content is damaged or
// not supported. They allocate no more than a few times kMaxDepthMapSize^2
// numbers, and no more than a few times what deflate could expand the file to.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <cstdint>
#include <cstring>
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

// Numbers of any shape in C order.
struct NumberArray {
  std::vector<uint64_t> shape;
  std::vector<float> values;
};

// The number that lies there in memory, aligned or not.
template <typename T>
T LoadNumber(const void* data) {
  T number;
  std::memcpy(&number, data, sizeof(T));
  return number;
}

// What the path ends in, with the dot, in small letters.
std::string LowerExtension(const std::string& path);

// Throws if there are more values than any depth map has.
uint64_t CountValues(const std::vector<uint64_t>& shape);

// Throws unless 1 <= width, height <= kMaxDepthMapSize.
void CheckGridSize(uint64_t width, uint64_t height);

// Throws if a file of that many bytes cannot, by deflate, have held the data;
// called before data_size bytes are allocated.
void CheckExpansion(uint64_t data_size, uint64_t file_size);

// The array as height x width after removing leading, then trailing, dimensions
// of size 1.
DepthGrid ToGrid(NumberArray array);
// The last coordinate of an array of points, height x width x 3 after removing
// leading dimensions of size 1.
DepthGrid ToGridOfZ(const NumberArray& points);

// NumPy array (format versions 1 to 3) of floats of 2, 4 or 8 bytes, integers
// of 1 to 8 bytes or booleans, either byte order, C or Fortran order. Allocates
// at most four times the bytes.
NumberArray ParseNpy(std::string bytes);

// From the bits of half-precision floats.
std::vector<float> HalfsToFloats(const std::vector<uint16_t>& halfs);

// Portable float map of one channel ("Pf"). Byte order by the sign of its
// scale, whose size is ignored, as every reader does.
DepthGrid ParsePfm(const std::string& bytes);

// Grayscale PNG of 8 or 16 bits with the numbers as they are.
DepthGrid ParsePng(std::string bytes, int bit_depth);

// Map of COLMAP's dense stereo: "width&height&1&", then floats from the top.
DepthGrid ParseDenseBin(const std::string& bytes);

// OpenEXR, scan lines or tiles, any compression: of the first part the only
// channel, or the one called Z, depth, V or Y (also behind a layer's name).
// Numbers from 1e9 on, which renderers write where there is nothing, are
// infinite. Outside the data window depth is unknown.
DepthGrid ParseExr(const std::string& bytes);

// The first page of a TIFF file, strips or tiles, any compression that libtiff
// reads: one sample per pixel, floats of 2, 4 or 8 bytes or integers without
// sign of 1, 2 or 4.
DepthGrid ReadTiff(const std::string& path);

// Little endian, C order, format version 1.
std::string FormatNpyHalf(const DepthGrid& grid);
std::string FormatNpyFloat(const DepthGrid& grid);

std::string FormatDenseBin(const DepthGrid& grid);
// One channel Z of floats, ZIP compression.
std::string FormatExr(const DepthGrid& grid);

// Row-major values from the top.
std::string FormatPng16(int width,
                        int height,
                        const std::vector<uint16_t>& values);

}  // namespace dgsfm::internal
