#include "colmap_ext/depth/raw_depth.h"

#include "colmap_ext/depth/image_orientation.h"
#include "colmap_ext/formats/gray_picture.h"
#include "colmap_ext/formats/hdf5_format.h"
#include "colmap_ext/formats/npz_format.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <stdexcept>
#include <utility>

namespace dgsfm::internal {
namespace {

constexpr float kUnknownInPng = 65535;

// Throws with the reason if the file cannot be read or is too large.
void CheckFile(const std::string& path) {
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw std::runtime_error(error.message());
  if (size > kMaxFileBytes) {
    throw std::runtime_error("the file is too large for a depth map");
  }
}

std::string ReadFile(const std::string& path) {
  std::string bytes(std::filesystem::file_size(path), '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file.read(bytes.data(), bytes.size())) {
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
  // Networks do not agree on the plural.
  raw.intrinsics = read("intrinsics");
  if (!raw.intrinsics) raw.intrinsics = read("intrinsic");
  return raw;
}

// The only grid of a file other than PNG; PNG by a function of its own.
template <typename ParsePicture>
DepthGrid ReadGrid(const std::string& path, const ParsePicture& parse_png) {
  const std::string extension = LowerExtension(path);
  CheckFile(path);
  if (extension == ".tif" || extension == ".tiff") return ReadTiff(path);
  std::string bytes = ReadFile(path);
  if (extension == ".npy") return ToGrid(ParseNpy(std::move(bytes)));
  if (extension == ".pfm") return ParsePfm(bytes);
  if (extension == ".png") return parse_png(std::move(bytes));
  if (extension == ".exr") return ParseExr(bytes);
  if (extension == ".bin") return ParseDenseBin(bytes);
  throw std::runtime_error("the extension '" + extension +
                           "' is no known depth format");
}

// Numbers of a PNG. Sensors write the largest there is where they measure
// nothing.
DepthGrid ReadDepthPng(std::string bytes) {
  DepthGrid grid = ParsePng(std::move(bytes), /*bit_depth=*/16);
  for (float& value : grid.values) {
    if (value == kUnknownInPng) value = 0;
  }
  return grid;
}

// The same of a picture. The largest disparity is that of the nearest surface.
DepthGrid ReadRelativePng(std::string bytes, DepthType type) {
  GrayPicture picture = ParseGrayPicture(std::move(bytes));
  if (type == DepthType::RELATIVE_DEPTH) {
    for (float& value : picture.grid.values) {
      if (value == picture.max_value) value = 0;
    }
  }
  return std::move(picture.grid);
}

RawDepth ReadArraysOrGrid(const DepthFile& file, DepthType type) {
  if (file.arrays) return ReadArrays(file.arrays);
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
  raw.depth = ReadGrid(file.path, [&](std::string bytes) {
    return IsAffine(type) ? ReadRelativePng(std::move(bytes), type)
                          : ReadDepthPng(std::move(bytes));
  });
  return raw;
}

DepthGrid ReadConfidence(const std::string& path) {
  try {
    return ReadGrid(path, [](std::string bytes) {
      return ParsePng(std::move(bytes), /*bit_depth=*/8);
    });
  } catch (const std::runtime_error& error) {
    throw std::runtime_error("confidence " + path + ": " + error.what());
  }
}

void CheckSize(const DepthGrid& other,
               const std::string& name,
               const DepthGrid& depth) {
  if (other.width == depth.width && other.height == depth.height) return;
  throw std::runtime_error(
      "the " + name + " is " + FormatSize(other.width, other.height) +
      " but the depth map " + FormatSize(depth.width, depth.height));
}

// Makes depth unknown where the other grid, if there is one, does not have a
// number that is_kept(number).
template <typename IsKept>
void ExcludePixels(const std::optional<DepthGrid>& other,
                   const std::string& name,
                   const IsKept& is_kept,
                   DepthGrid* depth) {
  if (!other) return;
  CheckSize(*other, name, *depth);
  for (size_t i = 0; i < depth->values.size(); ++i) {
    if (!is_kept(other->values[i])) depth->values[i] = 0;
  }
}

// Precision in place of a confidence. Of lengths it is relative, as all
// estimators have it.
DepthGrid PrecisionOf(const DepthGrid& uncertainty,
                      const DepthGrid& depth,
                      DepthType type) {
  const bool is_length = type == DepthType::Z || type == DepthType::RANGE;
  DepthGrid precision = uncertainty;
  for (size_t i = 0; i < precision.values.size(); ++i) {
    precision.values[i] =
        (is_length ? depth.values[i] : 1) / uncertainty.values[i];
  }
  return precision;
}

// The bound of min_relative_confidence for a map.
float LeastConfidence(const DepthGrid& confidence,
                      const DepthGrid& depth,
                      double min_relative_confidence) {
  constexpr double kBestQuantile = 0.95;
  std::vector<float> known;
  for (size_t i = 0; i < confidence.values.size(); ++i) {
    const float value = confidence.values[i];
    if (depth.values[i] != 0 && value > 0 && std::isfinite(value)) {
      known.push_back(value);
    }
  }
  if (known.empty()) return 0;
  const auto best =
      known.begin() + static_cast<size_t>(kBestQuantile * (known.size() - 1));
  std::nth_element(known.begin(), best, known.end());
  return static_cast<float>(min_relative_confidence * *best);
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
  // No comparison with NaN holds, so that it excludes.
  const auto is_in_mask = [](float mask) { return mask > 0; };
  const auto is_confident = [&](float confidence) {
    return confidence > 0 && confidence >= options.min_confidence;
  };
  const auto is_certain = [&](float uncertainty) {
    return uncertainty <= options.max_uncertainty;
  };
  ExcludePixels(raw->mask, "mask", is_in_mask, &raw->depth);
  ExcludePixels(raw->confidence, "confidence", is_confident, &raw->depth);
  if (options.max_uncertainty > 0) {
    ExcludePixels(raw->uncertainty, "uncertainty", is_certain, &raw->depth);
  }
  if (options.min_relative_confidence == 0) return;
  std::optional<DepthGrid> confidence = raw->confidence;
  if (!confidence && raw->uncertainty) {
    CheckSize(*raw->uncertainty, "uncertainty", raw->depth);
    confidence = PrecisionOf(*raw->uncertainty, raw->depth, options.type);
  }
  if (!confidence) return;
  const float least =
      LeastConfidence(*confidence, raw->depth, options.min_relative_confidence);
  // A number that is none is of no influence here.
  ExcludePixels(
      confidence,
      "confidence",
      [least](float value) { return !(value < least); },
      &raw->depth);
}

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
