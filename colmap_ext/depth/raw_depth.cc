#include "colmap_ext/depth/raw_depth.h"

#include "colmap_ext/depth/image_orientation.h"
#include "colmap_ext/formats/gray_picture.h"
#include "colmap_ext/formats/hdf5_format.h"
#include "colmap_ext/formats/npz_format.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <stdexcept>
#include <utility>

namespace dgsfm::internal {
namespace {

constexpr float kUnknownInPng = 65535;

std::vector<uint8_t> ReadFile(const std::string& path) {
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw std::runtime_error(error.message());
  if (size > kMaxFileBytes) {
    throw std::runtime_error("the file is too large for a depth map");
  }
  std::vector<uint8_t> bytes(size);
  std::ifstream file(path, std::ios::binary);
  if (!file.read(reinterpret_cast<char*>(bytes.data()), bytes.size())) {
    throw std::runtime_error(std::strerror(errno));
  }
  return bytes;
}

// `read` gives the array of a name, if there is one.
template <typename Read>
RawDepth ReadArrays(const Read& read) {
  const auto read_grid = [&](std::initializer_list<const char*> names)
      -> std::optional<DepthGrid> {
    for (const char* name : names) {
      if (auto array = read(name)) return ToGrid(std::move(*array));
    }
    return std::nullopt;
  };
  RawDepth raw;
  if (auto depth = read_grid({"depth"})) {
    raw.depth = std::move(*depth);
  } else if (const auto points = read("points")) {
    raw.depth = ToGridOfZ(*points);
  } else {
    throw std::runtime_error("no array named depth or points");
  }
  raw.mask = read_grid({"mask"});
  raw.confidence = read_grid({"conf", "confidence"});
  raw.uncertainty = read_grid({"uncertainty"});
  raw.intrinsics = read("intrinsics");
  if (!raw.intrinsics) raw.intrinsics = read("intrinsic");
  return raw;
}

// The only grid of a file other than PNG; PNG by a function of its own.
template <typename ParsePicture>
DepthGrid ReadGrid(const std::string& path, const ParsePicture& parse_png) {
  const std::string extension = LowerExtension(path);
  const std::vector<uint8_t> bytes = ReadFile(path);
  if (extension == ".npy") return ToGrid(ParseNpy(bytes));
  if (extension == ".pfm") return ParsePfm(bytes);
  if (extension == ".png") return parse_png(bytes);
  if (extension == ".exr") return ParseExr(bytes);
  if (extension == ".bin") return ParseDenseBin(bytes);
  if (extension == ".tif" || extension == ".tiff") {
    return ParseTiff(bytes);
  }
  throw std::runtime_error("the extension '" + extension +
                           "' is no known depth format");
}

// Numbers of a PNG, with the largest there is unknown.
DepthGrid ReadDepthPng(const std::vector<uint8_t>& bytes) {
  DepthGrid grid = ParsePng(bytes, /*bit_depth=*/16);
  for (float& value : grid.values) {
    if (value == kUnknownInPng) value = 0;
  }
  return grid;
}

// The same of a picture. The largest disparity is that of the nearest surface.
DepthGrid ReadRelativePng(const std::vector<uint8_t>& bytes, DepthType type) {
  GrayPicture picture = ParseGrayPicture(bytes);
  if (type == DepthType::RELATIVE_DEPTH) {
    for (float& value : picture.grid.values) {
      if (value == picture.max_value) value = 0;
    }
  }
  return std::move(picture.grid);
}

RawDepth ReadArraysOrGrid(const DepthFile& file, DepthType type) {
  if (IsHdf5Path(file.path)) {
    const Hdf5File archive(file.path);
    return ReadArrays(
        [&](const char* name) { return archive.Read(file.group, name); });
  }
  const std::string extension = LowerExtension(file.path);
  if (extension == ".npz") {
    const NpzFile archive(file.path);
    return ReadArrays([&](const char* name) { return archive.Read(name); });
  }
  RawDepth raw;
  raw.depth = ReadGrid(file.path, [&](const std::vector<uint8_t>& bytes) {
    return IsAffine(type) ? ReadRelativePng(bytes, type) : ReadDepthPng(bytes);
  });
  return raw;
}

DepthGrid ReadConfidence(const std::string& path) {
  try {
    return ReadGrid(path, [](const std::vector<uint8_t>& bytes) {
      return ParsePng(bytes, /*bit_depth=*/8);
    });
  } catch (const std::runtime_error& error) {
    throw std::runtime_error("confidence " + path + ": " + error.what());
  }
}

// Makes depth unknown where is_unknown(value of the other grid).
template <typename IsUnknown>
void ExcludePixels(const DepthGrid& other,
                   const std::string& name,
                   const IsUnknown& is_unknown,
                   DepthGrid* depth) {
  if (other.width != depth->width || other.height != depth->height) {
    throw std::runtime_error(
        "the " + name + " is " + FormatSize(other.width, other.height) +
        " but the depth map " + FormatSize(depth->width, depth->height));
  }
  for (size_t i = 0; i < depth->values.size(); ++i) {
    if (is_unknown(other.values[i])) depth->values[i] = 0;
  }
}

}  // namespace

std::string FormatSize(size_t width, size_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

RawDepth ReadRawDepth(const DepthFile& file, DepthType type) {
  RawDepth raw = ReadArraysOrGrid(file, type);
  if (!file.confidence_path.empty()) {
    raw.confidence = ReadConfidence(file.confidence_path);
  }
  return raw;
}

void ApplyConfidence(const DepthReadOptions& options, RawDepth* raw) {
  // Written so that NaN excludes.
  if (raw->mask) {
    ExcludePixels(
        *raw->mask,
        "mask",
        [](float mask) { return !(mask > 0); },
        &raw->depth);
  }
  if (raw->confidence) {
    ExcludePixels(
        *raw->confidence,
        "confidence",
        [&](float confidence) {
          return !(confidence > 0 && confidence >= options.min_confidence);
        },
        &raw->depth);
  }
  if (raw->uncertainty && options.max_uncertainty > 0) {
    ExcludePixels(
        *raw->uncertainty,
        "uncertainty",
        [&](float uncertainty) {
          return !(uncertainty <= options.max_uncertainty);
        },
        &raw->depth);
  }
}

// The map of the image as stored from that of the image as displayed.
DepthGrid TurnBack(const DepthGrid& grid, int orientation) {
  if (orientation == 1) return grid;
  DepthGrid turned = {grid.width, grid.height, {}};
  TurnSize(orientation, &turned.width, &turned.height);
  turned.values.reserve(grid.values.size());
  for (int y = 0; y < turned.height; ++y) {
    for (int x = 0; x < turned.width; ++x) {
      const auto [displayed_x, displayed_y] =
          DisplayedPixel(orientation, turned.width, turned.height, x, y);
      turned.values.push_back(
          grid.values[size_t(displayed_y) * grid.width + displayed_x]);
    }
  }
  return turned;
}

}  // namespace dgsfm::internal
