#include "colmap_ext/formats/depth_file_formats.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <utility>

namespace dgsfm::internal {
namespace {

constexpr char kSpaces[] = " \t\n\v\f\r";

// The next token of a PFM header, which ends at white space.
std::string NextToken(const std::string& bytes, size_t* pos) {
  constexpr size_t kMaxTokenSize = 32;
  const size_t begin =
      std::min(bytes.find_first_not_of(kSpaces, *pos), bytes.size());
  *pos = std::min({bytes.find_first_of(kSpaces, begin),
                   begin + kMaxTokenSize,
                   bytes.size()});
  return bytes.substr(begin, *pos - begin);
}

uint64_t ParseCount(const std::string& token, const std::string& format) {
  if (token.empty() || token.size() > 9 ||
      token.find_first_not_of("0123456789") != std::string::npos) {
    throw std::runtime_error(format + " with the size '" + token + "'");
  }
  return std::stoull(token);
}

// Whether the data are little endian, by the sign of the scale.
bool ParseByteOrder(const std::string& token) {
  char* end = nullptr;
  const double scale = std::strtod(token.c_str(), &end);
  if (token.empty() || *end != '\0' || !std::isfinite(scale) || scale == 0) {
    throw std::runtime_error("PFM header with the scale '" + token + "'");
  }
  return scale < 0;
}

// A grid of the floats that are the rest of the bytes, little endian.
DepthGrid LoadGrid(const std::string& bytes,
                   size_t begin,
                   uint64_t width,
                   uint64_t height) {
  CheckGridSize(width, height);
  const size_t data_size = bytes.size() - std::min(begin, bytes.size());
  if (data_size != sizeof(float) * width * height) {
    throw std::runtime_error(
        std::to_string(data_size) + " bytes of data instead of the " +
        std::to_string(4 * width * height) + " of " + std::to_string(width) +
        " x " + std::to_string(height) + " values");
  }
  DepthGrid grid = {static_cast<int>(width),
                    static_cast<int>(height),
                    std::vector<float>(width * height)};
  std::memcpy(grid.values.data(), bytes.data() + begin, data_size);
  return grid;
}

}  // namespace

std::string LowerExtension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension();
  for (char& c : extension) c = std::tolower(static_cast<unsigned char>(c));
  return extension;
}

void CheckGridSize(uint64_t width, uint64_t height) {
  if (width >= 1 && height >= 1 && width <= kMaxDepthMapSize &&
      height <= kMaxDepthMapSize) {
    return;
  }
  throw std::runtime_error("a size of " + std::to_string(width) + " x " +
                           std::to_string(height) + " is not in 1 to " +
                           std::to_string(kMaxDepthMapSize));
}

uint64_t CountValues(const std::vector<uint64_t>& shape) {
  uint64_t count = 1;
  for (const uint64_t size : shape) {
    if (size > 0 && count > kMaxFileBytes / size) {
      throw std::runtime_error("an array that is larger than any depth map");
    }
    count *= size;
  }
  return count;
}

void CheckExpansion(uint64_t data_size, uint64_t file_size) {
  if (data_size / kMaxDeflateRatio <= file_size) return;
  throw std::runtime_error(
      "the file is truncated: " + std::to_string(file_size) +
      " bytes cannot hold " + std::to_string(data_size));
}

DepthGrid ToGrid(NumberArray array) {
  std::vector<uint64_t>& shape = array.shape;
  while (shape.size() > 2 && shape.front() == 1) shape.erase(shape.begin());
  while (shape.size() > 2 && shape.back() == 1) shape.pop_back();
  if (shape.size() != 2) {
    throw std::runtime_error("an array of " + std::to_string(shape.size()) +
                             " dimensions is no depth map");
  }
  CheckGridSize(shape[1], shape[0]);
  return {static_cast<int>(shape[1]),
          static_cast<int>(shape[0]),
          std::move(array.values)};
}

DepthGrid ToGridOfZ(const NumberArray& points) {
  std::vector<uint64_t> shape = points.shape;
  while (shape.size() > 3 && shape.front() == 1) shape.erase(shape.begin());
  if (shape.size() != 3 || shape[2] != 3) {
    throw std::runtime_error("the array points is not height x width x 3");
  }
  CheckGridSize(shape[1], shape[0]);
  DepthGrid grid = {static_cast<int>(shape[1]), static_cast<int>(shape[0]), {}};
  grid.values.reserve(points.values.size() / 3);
  for (size_t i = 2; i < points.values.size(); i += 3) {
    grid.values.push_back(points.values[i]);
  }
  return grid;
}

DepthGrid ParsePfm(const std::string& bytes) {
  size_t pos = 0;
  const std::string magic = NextToken(bytes, &pos);
  if (magic == "PF") {
    throw std::runtime_error("PFM of three channels; depth needs one");
  }
  if (magic != "Pf") throw std::runtime_error("not a PFM file");
  const uint64_t width = ParseCount(NextToken(bytes, &pos), "PFM header");
  const uint64_t height = ParseCount(NextToken(bytes, &pos), "PFM header");
  const bool is_little_endian = ParseByteOrder(NextToken(bytes, &pos));
  // A single white space separates header and data.
  DepthGrid grid = LoadGrid(bytes, pos + 1, width, height);
  if (!is_little_endian) {
    for (float& value : grid.values) {
      auto* value_bytes = reinterpret_cast<char*>(&value);
      std::reverse(value_bytes, value_bytes + sizeof(value));
    }
  }
  // The file begins with the bottom row.
  for (size_t y = 0; y < height / 2; ++y) {
    const auto row = grid.values.begin() + y * width;
    std::swap_ranges(row, row + width, grid.values.end() - (y + 1) * width);
  }
  return grid;
}

DepthGrid ParseDenseBin(const std::string& bytes) {
  uint64_t sizes[3] = {0, 0, 0};
  size_t pos = 0;
  for (uint64_t& size : sizes) {
    const size_t end = bytes.find('&', pos);
    if (end == std::string::npos || end - pos > 10) {
      throw std::runtime_error("not a map of COLMAP's dense stereo");
    }
    size = ParseCount(bytes.substr(pos, end - pos), "map of dense stereo");
    pos = end + 1;
  }
  if (sizes[2] != 1) {
    throw std::runtime_error("a map of " + std::to_string(sizes[2]) +
                             " channels is no depth map");
  }
  return LoadGrid(bytes, pos, sizes[0], sizes[1]);
}

std::string FormatDenseBin(const DepthGrid& grid) {
  return std::to_string(grid.width) + "&" + std::to_string(grid.height) +
         "&1&" +
         std::string(reinterpret_cast<const char*>(grid.values.data()),
                     sizeof(float) * grid.values.size());
}

}  // namespace dgsfm::internal
