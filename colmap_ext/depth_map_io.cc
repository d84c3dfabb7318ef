#include "colmap_ext/depth_map_io.h"

#include "colmap_ext/check.h"
#include "colmap_ext/depth_file_formats.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <Eigen/Core>

namespace dgsfm {
namespace {

using internal::DepthGrid;

constexpr double kMaxAspectError = 0.02;

std::string FormatSize(size_t width, size_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

std::vector<uint8_t> ReadFile(const std::string& path) {
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw std::runtime_error(error.message());
  if (size > internal::kMaxFileBytes) {
    throw std::runtime_error("the file is too large for a depth map");
  }
  std::vector<uint8_t> bytes(size);
  std::ifstream file(path, std::ios::binary);
  if (!file.read(reinterpret_cast<char*>(bytes.data()), bytes.size())) {
    throw std::runtime_error(std::strerror(errno));
  }
  return bytes;
}

DepthGrid ReadGrid(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension();
  if (extension == ".npy") return internal::ParseNpy(ReadFile(path));
  if (extension == ".npz") {
    if (auto grid = internal::ReadNpz(path, "depth")) return std::move(*grid);
    throw std::runtime_error("no array named depth in the NumPy archive");
  }
  if (extension == ".pfm") return internal::ParsePfm(ReadFile(path));
  if (extension == ".png") return internal::ParsePng(ReadFile(path));
  throw std::runtime_error("the extension '" + extension +
                           "' is no known depth format");
}

// Relative difference of the aspects of two sizes.
double AspectError(double width1,
                   double height1,
                   double width2,
                   double height2) {
  return std::abs(std::log(width1 * height2 / (height1 * width2)));
}

bool IsTransposed(const DepthGrid& grid, const colmap::Camera& camera) {
  const double rounding = 1.0 / grid.width + 1.0 / grid.height;
  return AspectError(
             grid.height, grid.width, camera.Width(), camera.Height()) <=
             kMaxAspectError &&
         AspectError(grid.width, grid.height, camera.Width(), camera.Height()) >
             kMaxAspectError + rounding;
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
      grid->values[i] /= std::sqrt(1 + x_norm.squaredNorm());
    }
  }
}

// Turns what is no depth into unknown depth.
void CleanDepths(std::vector<float>* depths) {
  constexpr float kMaxDepth = std::numeric_limits<float>::max();
  for (float& depth : *depths) {
    if (!(depth > 0 && depth <= kMaxDepth)) depth = 0;
  }
}

DepthMap ConvertGrid(DepthGrid grid,
                     const colmap::Camera& camera,
                     const DepthReadOptions& options) {
  if (IsTransposed(grid, camera)) {
    throw std::runtime_error(
        "the depth map is " + FormatSize(grid.width, grid.height) +
        " but the image " + FormatSize(camera.Width(), camera.Height()) +
        ": one of them is turned by 90 degrees");
  }
  const float scale = static_cast<float>(options.scale);
  if (options.type == DepthType::INVERSE) {
    for (float& value : grid.values) value = scale / value;
  } else {
    for (float& value : grid.values) value *= scale;
  }
  if (options.type == DepthType::RANGE) MultiplyRayCosines(camera, &grid);
  CleanDepths(&grid.values);
  DepthMap depth_map = {
      grid.width, grid.height, options.unit, std::move(grid.values)};
  if (depth_map.Coverage() == 0) {
    throw std::runtime_error("no pixel of the " +
                             FormatSize(depth_map.width, depth_map.height) +
                             " depth map has a positive finite depth");
  }
  return depth_map;
}

// Mean focal length [px of the image] of the depth model's camera matrix, in
// units of the map's size or, if the principal point says so, of the map's
// pixels.
double FocalLengthOfIntrinsics(const DepthGrid& intrinsics,
                               const DepthMap& depth_map,
                               const colmap::Camera& camera) {
  if (intrinsics.width != 3 || intrinsics.height != 3) {
    throw std::runtime_error("the array intrinsics is no 3 x 3 matrix");
  }
  const double fx = intrinsics.values[0];
  const double fy = intrinsics.values[4];
  const bool is_normalized =
      intrinsics.values[2] <= 1 && intrinsics.values[5] <= 1;
  const double focal_length_px =
      0.5 * (fx / (is_normalized ? 1 : depth_map.width) * camera.Width() +
             fy / (is_normalized ? 1 : depth_map.height) * camera.Height());
  if (!(fx > 0 && fy > 0 && std::isfinite(focal_length_px))) {
    throw std::runtime_error(
        "the array intrinsics has no positive focal length");
  }
  return focal_length_px;
}

// A matrix that some networks write for want of one.
bool IsIdentity(const DepthGrid& grid) {
  return grid.values == std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1};
}

}  // namespace

bool DepthReadOptions::IsValid(std::string* error) const {
  if (scale >= std::numeric_limits<float>::min() &&
      scale <= std::numeric_limits<float>::max()) {
    return true;
  }
  if (error != nullptr) {
    std::ostringstream message;
    message << "scale is " << scale << " but must be positive and finite";
    *error = message.str();
  }
  return false;
}

const std::vector<std::string>& DepthFileExtensions() {
  static const std::vector<std::string> kExtensions = {
      ".npy", ".npz", ".pfm", ".png"};
  return kExtensions;
}

DepthMap ReadDepthMap(const std::string& path,
                      const colmap::Camera& camera,
                      const DepthReadOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(camera.Width() > 0 && camera.Height() > 0)
      << "camera " << camera.CameraId();
  try {
    return ConvertGrid(ReadGrid(path), camera, options);
  } catch (const std::runtime_error& failure) {
    throw std::runtime_error("depth map " + path + ": " + failure.what());
  }
}

double ReadDepthFocalLength(const std::string& path,
                            const DepthMap& depth_map,
                            const colmap::Camera& camera) {
  if (std::filesystem::path(path).extension() != ".npz") return 0;
  try {
    const auto intrinsics = internal::ReadNpz(path, "intrinsics");
    if (!intrinsics || IsIdentity(*intrinsics)) return 0;
    return FocalLengthOfIntrinsics(*intrinsics, depth_map, camera);
  } catch (const std::runtime_error& failure) {
    throw std::runtime_error("depth map " + path + ": " + failure.what());
  }
}

void WriteDepthNpy(const std::string& path,
                   const DepthMap& depth_map,
                   NpyPrecision precision) {
  const DepthGrid grid = {depth_map.width, depth_map.height, depth_map.values};
  const std::vector<uint8_t> bytes = precision == NpyPrecision::HALF
                                         ? internal::FormatNpyHalf(grid)
                                         : internal::FormatNpyFloat(grid);
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  file.close();
  if (!file) throw std::runtime_error(path + ": " + std::strerror(errno));
}

void WriteDepthPng(const std::string& path,
                   const DepthMap& depth_map,
                   double scale) {
  DGSFM_CHECK(scale > 0) << "scale = " << scale;
  std::vector<uint16_t> steps;
  steps.reserve(depth_map.values.size());
  for (const float depth : depth_map.values) {
    const double step = std::clamp(std::round(depth / scale), 1.0, 65534.0);
    steps.push_back(depth > 0 ? static_cast<uint16_t>(step) : 0);
  }
  internal::WritePng16(path, depth_map.width, depth_map.height, steps);
}

}  // namespace dgsfm
