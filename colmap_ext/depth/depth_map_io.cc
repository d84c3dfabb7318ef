#include "colmap_ext/depth/depth_map_io.h"

#include "colmap_ext/check.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/depth/image_orientation.h"
#include "colmap_ext/depth/raw_depth.h"
#include "colmap_ext/formats/depth_file_formats.h"
#include "colmap_ext/output_file.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <Eigen/Core>

namespace dgsfm {
namespace {

using internal::DepthGrid;
using internal::NumberArray;
using internal::RawDepth;

constexpr double kMaxAspectError = 0.02;
constexpr double kUnknownStep = 65535;

// Relative difference of the aspects of two sizes.
double AspectError(double width1,
                   double height1,
                   double width2,
                   double height2) {
  return std::abs(std::log(width1 * height2 / (height1 * width2)));
}

// Difference that rounding the sides of the map explains.
double MaxAspectError(const DepthGrid& grid) {
  return kMaxAspectError + 1.0 / grid.width + 1.0 / grid.height;
}

// Throws for a turned map and for one of another aspect.
void CheckAspect(const DepthGrid& grid,
                 const colmap::Camera& camera,
                 double max_aspect_factor) {
  const double error =
      AspectError(grid.width, grid.height, camera.Width(), camera.Height());
  // A map that fits when transposed is certainly turned, whereas one that fits
  // neither way may come from a network of square input.
  const double transposed_error =
      AspectError(grid.height, grid.width, camera.Width(), camera.Height());
  const std::string sizes =
      "the depth map is " + internal::FormatSize(grid.width, grid.height) +
      " but the image " + internal::FormatSize(camera.Width(), camera.Height());
  if (transposed_error <= kMaxAspectError && error > MaxAspectError(grid)) {
    throw std::runtime_error(sizes +
                             ": one of them is turned by 90 degrees (for "
                             "images with an EXIF orientation see "
                             "--displayed_image_path)");
  }
  if (error >
      std::log(max_aspect_factor) + 1.0 / grid.width + 1.0 / grid.height) {
    std::ostringstream message;
    message << sizes << ": width to height differs by the factor "
            << std::exp(error) << ", more than max_aspect_factor, "
            << max_aspect_factor;
    throw std::runtime_error(message.str());
  }
}

// z-depth per length of the ray through each pixel; NaN where there is no ray.
void MultiplyRayCosines(const colmap::Camera& camera, DepthGrid* grid) {
  DGSFM_CHECK(camera.VerifyParams()) << "camera " << camera.CameraId();
  const double x_scale = static_cast<double>(camera.Width()) / grid->width;
  const double y_scale = static_cast<double>(camera.Height()) / grid->height;
  size_t i = 0;
  for (int y = 0; y < grid->height; ++y) {
    for (int x = 0; x < grid->width; ++x, ++i) {
      const Eigen::Vector2d x_norm =
          camera.ImageToWorld({(x + 0.5) * x_scale, (y + 0.5) * y_scale});
      // A ray that does not exist has NaN coordinates, which make depth
      // unknown.
      grid->values[i] /= std::sqrt(1 + x_norm.squaredNorm());
    }
  }
}

// Makes values unknown that no depth has; returns the number of known ones.
size_t CleanDepths(double max_depth, std::vector<float>* depths) {
  constexpr float kMaxFloat = std::numeric_limits<float>::max();
  const float bound = max_depth > 0 && max_depth < kMaxFloat
                          ? static_cast<float>(max_depth)
                          : kMaxFloat;
  uint32_t num_known = 0;
  for (float& depth : *depths) {
    // Without branches, which NaN fails too.
    const bool is_known = (depth > 0) & (depth <= bound);
    depth = is_known ? depth : 0;
    num_known += is_known;
  }
  return num_known;
}

// Makes infinite values and NaN unknown; returns the number of known values.
size_t CleanAffineValues(std::vector<float>* values) {
  size_t num_known = 0;
  for (float& value : *values) {
    if (!std::isfinite(value)) value = 0;
    num_known += value != 0;
  }
  return num_known;
}

DepthUnit UnitOf(const DepthReadOptions& options) {
  switch (options.type) {
    case DepthType::RELATIVE_DISPARITY:
      return DepthUnit::AFFINE_DISPARITY;
    case DepthType::RELATIVE_DEPTH:
      return DepthUnit::AFFINE_DEPTH;
    default:
      return options.unit;
  }
}

// Depth from the numbers, unknown where they are none; returns how many are
// known.
size_t ConvertValues(const colmap::Camera& camera,
                     const DepthReadOptions& options,
                     DepthGrid* grid) {
  if (IsAffine(options.type)) return CleanAffineValues(&grid->values);
  const float scale = static_cast<float>(options.scale);
  if (options.type == DepthType::INVERSE) {
    for (float& value : grid->values) value = scale / value;
  } else if (scale != 1) {
    for (float& value : grid->values) value *= scale;
  }
  if (options.type == DepthType::RANGE) MultiplyRayCosines(camera, grid);
  return CleanDepths(options.max_depth, &grid->values);
}

// Sets map and coverage.
void ConvertGrid(DepthGrid grid,
                 const colmap::Camera& camera,
                 const DepthReadOptions& options,
                 ImportedDepth* result) {
  CheckAspect(grid, camera, options.max_aspect_factor);
  const size_t num_known = ConvertValues(camera, options, &grid);
  if (num_known == 0) {
    throw std::runtime_error("no pixel of the " +
                             internal::FormatSize(grid.width, grid.height) +
                             " depth map has a positive finite depth that "
                             "mask, confidence and max_depth leave");
  }
  result->coverage = static_cast<double>(num_known) / grid.values.size();
  result->depth_map = {
      grid.width, grid.height, UnitOf(options), std::move(grid.values)};
}

struct Size {
  double width = 0;
  double height = 0;
};

// What a camera matrix has as its unit: pixels of the map or of the image, or
// the sides themselves. That whose centre is next to the principal point.
Size FindUnit(double cx, double cy, const Size& map, const Size& image) {
  const auto offset = [&](const Size& size) {
    return std::hypot(cx / size.width - 0.5, cy / size.height - 0.5);
  };
  const Size units[] = {map, {1, 1}, image};
  const Size unit = *std::min_element(
      std::begin(units), std::end(units), [&](const Size& a, const Size& b) {
        return offset(a) < offset(b);
      });
  if (!(offset(unit) < 0.5)) {
    std::ostringstream message;
    message << "the principal point (" << cx << ", " << cy
            << ") of the array intrinsics is far from the centre of the "
            << internal::FormatSize(map.width, map.height)
            << " map, of the image and of the unit square";
    throw std::runtime_error(message.str());
  }
  return unit;
}

// Mean focal length [px of the image] of the depth model's camera matrix; of a
// vector the first number, in pixels of the map. Map and image as the model saw
// them.
double FocalLengthOfIntrinsics(const NumberArray& intrinsics,
                               const Size& map,
                               const Size& image) {
  const std::vector<float>& values = intrinsics.values;
  // A matrix that some networks write for want of one.
  if (values == std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1}) return 0;
  const bool is_matrix = values.size() == 9;
  if (!is_matrix && (values.empty() || values.size() > 4)) {
    throw std::runtime_error(
        "the array intrinsics is neither a 3 x 3 matrix nor a vector that "
        "begins with the focal length");
  }
  const double fx = values[0];
  const double fy = is_matrix ? values[4] : fx;
  const Size unit =
      is_matrix ? FindUnit(values[2], values[5], map, image) : map;
  const double focal_length_px =
      0.5 * (fx / unit.width * image.width + fy / unit.height * image.height);
  if (!(fx > 0 && fy > 0 && std::isfinite(focal_length_px))) {
    throw std::runtime_error(
        "the array intrinsics has no positive focal length");
  }
  return focal_length_px;
}

ImportedDepth ConvertRawDepth(RawDepth raw,
                              int orientation,
                              const colmap::Camera& camera,
                              const DepthReadOptions& options) {
  ImportedDepth result;
  if (raw.intrinsics) {
    int width = static_cast<int>(camera.Width());
    int height = static_cast<int>(camera.Height());
    TurnSize(orientation, &width, &height);
    result.focal_length_px = FocalLengthOfIntrinsics(
        *raw.intrinsics,
        {double(raw.depth.width), double(raw.depth.height)},
        {double(width), double(height)});
  }
  // Masks are in the frame of the model's input, so they apply before turning.
  internal::ApplyConfidence(options, &raw);
  if (orientation != 1) raw.depth = internal::TurnBack(raw.depth, orientation);
  result.is_stretched =
      AspectError(
          raw.depth.width, raw.depth.height, camera.Width(), camera.Height()) >
      MaxAspectError(raw.depth);
  ConvertGrid(std::move(raw.depth), camera, options, &result);
  return result;
}

DepthGrid GridOf(const DepthMap& depth_map) {
  return {depth_map.width, depth_map.height, depth_map.values};
}

}  // namespace

bool IsAffine(DepthType type) {
  return type == DepthType::RELATIVE_DISPARITY ||
         type == DepthType::RELATIVE_DEPTH;
}

bool DepthReadOptions::IsValid(std::string* error) const {
  if (IsAffine(type) && (scale != 1 || max_depth != 0)) {
    if (error != nullptr) {
      *error =
          "depth_scale and max_depth have no meaning for relative disparity "
          "and relative depth, whose scale and shift are unknown";
    }
    return false;
  }
  using Limits = std::numeric_limits<float>;
  struct Bound {
    const char* name;
    double value;
    bool is_kept;
    const char* requirement;
  };
  const bool is_float = scale >= Limits::min() && scale <= Limits::max();
  const bool is_number = !std::isnan(min_confidence);
  const Bound bounds[] = {
      {"scale", scale, is_float, "positive and finite"},
      {"max_depth", max_depth, max_depth >= 0, "at least 0"},
      {"min_confidence", min_confidence, is_number, "a number"},
      {"min_relative_confidence",
       min_relative_confidence,
       min_relative_confidence >= 0 && min_relative_confidence < 1,
       "in [0, 1)"},
      {"max_uncertainty", max_uncertainty, max_uncertainty >= 0, "at least 0"},
      {"max_aspect_factor",
       max_aspect_factor,
       max_aspect_factor >= 1,
       "at least 1"}};
  for (const Bound& bound : bounds) {
    if (bound.is_kept) continue;
    std::ostringstream message;
    message << bound.name << " is " << bound.value << " but must be "
            << bound.requirement;
    if (error != nullptr) *error = message.str();
    return false;
  }
  return true;
}

std::string DepthFile::Description() const {
  return group.empty() ? path : path + ":" + group;
}

const std::vector<std::string>& DepthFileExtensions() {
  static const std::vector<std::string> kExtensions = {
      ".npy", ".npz", ".exr", ".tif", ".tiff", ".pfm", ".png", ".bin"};
  return kExtensions;
}

ImportedDepth ReadDepth(const DepthFile& file,
                        const colmap::Camera& camera,
                        const DepthReadOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(camera.Width() > 0 && camera.Height() > 0)
      << "camera " << camera.CameraId();
  try {
    RawDepth raw = internal::ReadRawDepth(file, options.type);
    return ConvertRawDepth(std::move(raw), file.orientation, camera, options);
  } catch (const std::runtime_error& failure) {
    throw std::runtime_error("depth map " + file.Description() + ": " +
                             failure.what());
  }
}

DepthMap ReadDepthMap(const std::string& path,
                      const colmap::Camera& camera,
                      const DepthReadOptions& options) {
  DepthFile file;
  file.path = path;
  return ReadDepth(file, camera, options).depth_map;
}

void WriteDepthNpy(const std::string& path,
                   const DepthMap& depth_map,
                   NpyPrecision precision) {
  WriteFile(path,
            precision == NpyPrecision::HALF
                ? internal::FormatNpyHalf(GridOf(depth_map))
                : internal::FormatNpyFloat(GridOf(depth_map)));
}

void WriteDepthExr(const std::string& path, const DepthMap& depth_map) {
  WriteFile(path, internal::FormatExr(GridOf(depth_map)));
}

void WriteDepthDenseBin(const std::string& path, const DepthMap& depth_map) {
  WriteFile(path, internal::FormatDenseBin(GridOf(depth_map)));
}

bool WriteDepthPng(const std::string& path,
                   const DepthMap& depth_map,
                   double scale) {
  DGSFM_CHECK(scale > 0) << "scale = " << scale;
  std::vector<uint16_t> steps;
  steps.reserve(depth_map.values.size());
  for (const float depth : depth_map.values) {
    const double step = std::max(1.0, std::round(depth / scale));
    const bool is_known = depth > 0 && step < kUnknownStep;
    steps.push_back(is_known ? static_cast<uint16_t>(step) : 0);
  }
  WriteFile(path,
            internal::FormatPng16(depth_map.width, depth_map.height, steps));
  return std::any_of(
      steps.begin(), steps.end(), [](uint16_t step) { return step > 0; });
}

}  // namespace dgsfm
