#include "colmap_ext/formats/depth_file_formats.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include <boost/endian/conversion.hpp>

namespace dgsfm::internal {
namespace {

// The next token of a PFM header, which ends at white space.
std::string NextToken(const std::vector<uint8_t>& bytes, size_t* pos) {
  constexpr size_t kMaxTokenSize = 32;
  while (*pos < bytes.size() && std::isspace(bytes[*pos])) ++*pos;
  std::string token;
  while (*pos < bytes.size() && !std::isspace(bytes[*pos]) &&
         token.size() < kMaxTokenSize) {
    token.push_back(static_cast<char>(bytes[(*pos)++]));
  }
  return token;
}

uint64_t ParseCount(const std::string& token, const std::string& format) {
  if (token.empty() || token.size() > 9 ||
      !std::all_of(token.begin(), token.end(), [](unsigned char c) {
        return std::isdigit(c);
      })) {
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

void CheckDataSize(size_t data_size, uint64_t width, uint64_t height) {
  if (data_size == 4 * width * height) return;
  throw std::runtime_error(
      std::to_string(data_size) + " bytes of data instead of the " +
      std::to_string(4 * width * height) + " of " + std::to_string(width) +
      " x " + std::to_string(height) + " values");
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

DepthGrid ParsePfm(const std::vector<uint8_t>& bytes) {
  size_t pos = 0;
  const std::string magic = NextToken(bytes, &pos);
  if (magic == "PF") {
    throw std::runtime_error("PFM of three channels; depth needs one");
  }
  if (magic != "Pf") throw std::runtime_error("not a PFM file");
  const uint64_t width = ParseCount(NextToken(bytes, &pos), "PFM header");
  const uint64_t height = ParseCount(NextToken(bytes, &pos), "PFM header");
  const bool is_little_endian = ParseByteOrder(NextToken(bytes, &pos));
  CheckGridSize(width, height);
  // A single white space separates header and data.
  const size_t data_size = bytes.size() - std::min(pos + 1, bytes.size());
  CheckDataSize(data_size, width, height);
  DepthGrid grid = {static_cast<int>(width), static_cast<int>(height), {}};
  grid.values.resize(width * height);
  const uint8_t* data = bytes.data() + pos + 1;
  for (size_t y = height; y-- > 0;) {  // the file begins at the bottom
    for (size_t x = 0; x < width; ++x, data += 4) {
      using namespace boost::endian;
      grid.values[y * width + x] =
          is_little_endian ? endian_load<float, 4, order::little>(data)
                           : endian_load<float, 4, order::big>(data);
    }
  }
  return grid;
}

DepthGrid ParseDenseBin(const std::vector<uint8_t>& bytes) {
  uint64_t sizes[3] = {0, 0, 0};
  size_t pos = 0;
  for (uint64_t& size : sizes) {
    std::string token;
    while (pos < bytes.size() && bytes[pos] != '&' && token.size() < 10) {
      token.push_back(static_cast<char>(bytes[pos++]));
    }
    if (pos >= bytes.size() || bytes[pos++] != '&') {
      throw std::runtime_error("not a map of COLMAP's dense stereo");
    }
    size = ParseCount(token, "map of dense stereo");
  }
  CheckGridSize(sizes[0], sizes[1]);
  if (sizes[2] != 1) {
    throw std::runtime_error("a map of " + std::to_string(sizes[2]) +
                             " channels is no depth map");
  }
  const size_t num_values = sizes[0] * sizes[1];
  CheckDataSize(bytes.size() - pos, sizes[0], sizes[1]);
  DepthGrid grid = {static_cast<int>(sizes[0]),
                    static_cast<int>(sizes[1]),
                    std::vector<float>(num_values)};
  for (size_t i = 0; i < num_values; ++i) {
    grid.values[i] =
        boost::endian::endian_load<float, 4, boost::endian::order::little>(
            bytes.data() + pos + 4 * i);
  }
  return grid;
}

std::vector<uint8_t> FormatDenseBin(const DepthGrid& grid) {
  const std::string header =
      std::to_string(grid.width) + "&" + std::to_string(grid.height) + "&1&";
  std::vector<uint8_t> bytes(header.begin(), header.end());
  bytes.resize(header.size() + 4 * grid.values.size());
  uint8_t* data = bytes.data() + header.size();
  for (const float value : grid.values) {
    boost::endian::endian_store<float, 4, boost::endian::order::little>(data,
                                                                        value);
    data += 4;
  }
  return bytes;
}

}  // namespace dgsfm::internal
