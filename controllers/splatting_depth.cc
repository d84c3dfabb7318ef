#include "controllers/splatting_depth.h"

#include "colmap_ext/formats/depth_file_formats.h"
#include "colmap_ext/output_file.h"
#include "controllers/output_folder.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr double kNumSteps = 65536;
constexpr double kMaxPixel = 65535;

// The loader's key of an image.
std::string Key(const std::string& image_name) {
  return fs::path(image_name).replace_extension().generic_string();
}

}  // namespace

std::string SplattingFileName(const std::string& image_name) {
  return Key(image_name) + ".png";
}

void CheckSplattingNames(const SplattingScales& scales) {
  std::map<std::string, std::string> name_of_key;
  for (const auto& [name, scale] : scales) {
    const auto [other, is_new] = name_of_key.emplace(Key(name), name);
    if (!is_new) {
      throw std::runtime_error("images " + other->second + " and " + name +
                               " would share the depth map " +
                               SplattingFileName(name));
    }
  }
}

double SplattingScale(double max_inverse_depth) {
  return max_inverse_depth * kNumSteps / kMaxPixel;
}

void WriteSplattingPng(const std::string& path,
                       const DepthMap& depth_map,
                       double scale) {
  std::vector<uint16_t> pixels;
  pixels.reserve(depth_map.values.size());
  for (const float depth : depth_map.values) {
    const double pixel =
        // 0 is unknown, so the farthest known depth is one step.
        std::clamp(std::round(kNumSteps / (scale * depth)), 1.0, kMaxPixel);
    pixels.push_back(depth > 0 ? static_cast<uint16_t>(pixel) : 0);
  }
  WriteFile(path,
            internal::FormatPng16(depth_map.width, depth_map.height, pixels));
}

void WriteSplattingParameters(const std::string& folder,
                              const SplattingScales& scales) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  for (const auto& [name, scale] : scales) {
    json[Key(name)] = {{"scale", scale}, {"offset", 0.0}};
    // A single pixel is enough: the loader scales maps to the image.
    if (scale > 0) continue;
    const fs::path path = PathInside(folder, SplattingFileName(name));
    CreateOutputFolder(path.parent_path().string());
    WriteFile(path.string(), internal::FormatPng16(1, 1, {0}));
  }
  WriteFile((fs::path(folder) / kSplattingParametersFile).string(),
            JsonText(json, 2) + "\n");
}

}  // namespace dgsfm
