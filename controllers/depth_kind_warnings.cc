#include "controllers/depth_kind_warnings.h"

#include "estimators/median.h"

#include <algorithm>
#include <sstream>

namespace dgsfm {
namespace {

// Depth that no camera sees in metres.
constexpr double kMaxMetricDepth = 200;
constexpr double kMaxOfEightBits = 255;
// Pictures of depth use most of their levels.
constexpr double kMinLevelsOfPicture = 100;
// Share of pixels at the largest value beyond which that value marks the sky or
// the reach of a sensor [1].
constexpr double kMaxShareAtMax = 0.02;
// Median over the maps of the ratio of their lowest third to the uppermost, or
// its inverse, beyond which they look like the other kind: 0.4 to 1.05 for
// depth of the sets of photos.
constexpr double kMinOddRatio = 1.15;
constexpr size_t kMinNumMaps = 3;

bool IsDisparity(DepthType type) {
  return type == DepthType::INVERSE || type == DepthType::RELATIVE_DISPARITY;
}

std::string Explanation(DepthOddity oddity, DepthType type) {
  switch (oddity) {
    case DepthOddity::MILLIMETRES:
      return "hold whole numbers above 200 in the median, as those of sensors "
             "in millimetres: if so, import them with --depth_scale 0.001";
    case DepthOddity::PICTURE:
      return "hold whole numbers up to 255, as pictures of depth: if so, "
             "import "
             "them with --depth_type relative_disparity where near is bright, "
             "relative_depth where near is dark";
    case DepthOddity::CONSTANT:
      return "have one value everywhere, which is no depth: check the depth "
             "model";
    case DepthOddity::SKY_AT_MAX:
      break;
  }
  return std::string(
             "have their largest value at many pixels, as where the sky or the "
             "reach of a sensor is written as such: ") +
         (IsAffine(type) ? "write it as 0 or NaN"
                         : "exclude it by --max_depth, or write it as 0");
}

std::string Warning(size_t num_maps,
                    const std::string& example,
                    const std::string& explanation) {
  std::ostringstream text;
  text << "warning: " << num_maps << " maps " << explanation << " (e.g. "
       << example << "; --overwrite 1)\n";
  return text.str();
}

std::string WarnOfOtherKind(const std::vector<DepthKindSample>& samples,
                            DepthType type) {
  if (samples.size() < kMinNumMaps) return "";
  std::vector<double> ratios;
  for (const DepthKindSample& sample : samples) {
    ratios.push_back(IsDisparity(type) ? 1 / sample.lower_to_upper
                                       : sample.lower_to_upper);
  }
  if (!(Median(std::move(ratios)) > kMinOddRatio)) return "";
  return Warning(
      samples.size(),
      samples.front().name,
      IsDisparity(type)
          ? "fall from the top of the images to the bottom, as depth does: if "
            "so, import them with --depth_type z or relative_depth"
          : "grow from the top of the images to the bottom, as disparity does: "
            "if so, import them with --depth_type relative_disparity, or "
            "inverse if they are 1 / z");
}

}  // namespace

std::vector<DepthOddity> FindOddities(const DepthMapStatistics& statistics,
                                      const DepthReadOptions& options) {
  std::vector<DepthOddity> oddities;
  const bool is_as_in_file =
      (options.type == DepthType::Z || options.type == DepthType::RANGE) &&
      options.scale == 1;
  if (statistics.is_constant) oddities.push_back(DepthOddity::CONSTANT);
  if (is_as_in_file && statistics.are_whole) {
    if (options.unit == DepthUnit::METRIC &&
        statistics.median > kMaxMetricDepth &&
        statistics.max > kMaxOfEightBits) {
      oddities.push_back(DepthOddity::MILLIMETRES);
    } else if (statistics.max <= kMaxOfEightBits &&
               statistics.max - statistics.min > kMinLevelsOfPicture) {
      oddities.push_back(DepthOddity::PICTURE);
    }
  }
  if (options.type != DepthType::RELATIVE_DISPARITY &&
      !statistics.is_constant && statistics.share_at_max > kMaxShareAtMax) {
    oddities.push_back(DepthOddity::SKY_AT_MAX);
  }
  return oddities;
}

std::string DepthKindWarnings(const std::vector<DepthKindSample>& samples,
                              DepthType type) {
  std::string text;
  for (const DepthOddity oddity : {DepthOddity::MILLIMETRES,
                                   DepthOddity::PICTURE,
                                   DepthOddity::CONSTANT,
                                   DepthOddity::SKY_AT_MAX}) {
    size_t num_maps = 0;
    std::string example;
    for (const DepthKindSample& sample : samples) {
      if (std::find(sample.oddities.begin(), sample.oddities.end(), oddity) ==
          sample.oddities.end()) {
        continue;
      }
      if (num_maps++ == 0) example = sample.name;
    }
    if (num_maps > 0) {
      text += Warning(num_maps, example, Explanation(oddity, type));
    }
  }
  return text + WarnOfOtherKind(samples, type);
}

std::string MissingMapsWarning(size_t num_missing, size_t num_images) {
  if (2 * num_missing <= num_images) return "";
  return "warning: " + std::to_string(num_missing) + " of " +
         std::to_string(num_images) +
         " images have no depth map, and depth helps pairs of two images with "
         "maps alone: let the depth model run on all images\n";
}

}  // namespace dgsfm
