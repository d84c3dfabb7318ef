#include "controllers/mapper_summary.h"

#include "controllers/mapper_report.h"
#include "estimators/median.h"
#include "sfm/stage_story.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <optional>
#include <vector>

namespace dgsfm {

namespace {

// More would push the rest of the summary off the screen.
constexpr size_t kMaxNumModels = 10;
constexpr size_t kMaxNumReasons = 5;
constexpr size_t kMaxNumNames = 3;
// Sound models of photos are below half a pixel; synthetic noise is one.
constexpr double kMaxMedianErrorPx = 1.5;

std::string Percent(double log_ratio) {
  const double percent = 100 * std::expm1(log_ratio);
  char text[32];
  std::snprintf(
      text, sizeof(text), percent < 1 ? "%.1f %%" : "%.0f %%", percent);
  return text;
}

// Median of the points' mean errors; nothing without points.
std::optional<double> MedianErrorPx(const colmap::Reconstruction& model) {
  std::vector<double> errors;
  for (const auto& [point_id, point] : model.Points3D()) {
    if (point.HasError()) errors.push_back(point.Error());
  }
  if (errors.empty()) return std::nullopt;
  return Median(std::move(errors));
}

std::string UnitText(const MeasuredUnit& measured) {
  if (measured.unit == ModelUnit::ARBITRARY) return "unit arbitrary";
  if (measured.unit == ModelUnit::RIGS) {
    return "unit that of the rigs' baselines";
  }
  const std::string maps = CountText(measured.num_images, "depth map");
  const std::string spread = Percent(measured.log_spread);
  if (measured.unit == ModelUnit::DEPTH_MAPS) {
    return "unit unknown: that of " + maps + ", which differ by " + spread;
  }
  // The standard error of a median of normal values.
  const double uncertainty = std::sqrt(M_PI / 2) * measured.log_spread /
                             std::sqrt(double(measured.num_images));
  return "unit metres, uncertain by " + Percent(uncertainty) + ": " + maps +
         ", which differ by " + spread +
         "; an error that all share is not seen";
}

std::string ModelText(const DepthGlobalMapperResult& result, size_t index) {
  const colmap::Reconstruction& model = *result.models[index];
  std::string text = "model " + std::to_string(index) + ": " +
                     CountText(model.NumRegImages(), "image") + ", " +
                     CountText(model.NumPoints3D(), "point");
  if (const auto error = MedianErrorPx(model)) {
    char number[64];
    std::snprintf(number, sizeof(number), ", median error %.2f px", *error);
    text += number;
  }
  return text + ", " + UnitText(result.units[index]) + "\n";
}

// What helps against a reason of global_mapping and component_mapping.
std::string RemedyOf(const std::string& reason) {
  const std::vector<std::pair<std::string, std::string>> remedies = {
      {"no key points", "extract features of it"},
      {"no matches", "match it with more images"},
      {"no valid pair", "images between it and the others help"},
      {"connected to only", "images between these and the others help"},
      {"not connected", "--DepthGlobalMapper.multiple_models 1 maps them"},
      {"its model has fewer",
       "--DepthGlobalMapper.min_model_size keeps small models"},
  };
  for (const auto& [beginning, remedy] : remedies) {
    if (reason.rfind(beginning, 0) == 0) return "; " + remedy;
  }
  return "";
}

std::vector<std::string> MissingImages(const Scene& scene,
                                       const DepthGlobalMapperResult& result) {
  std::map<std::string, std::vector<std::string>> names;
  for (const auto& [image_id, reason] : result.unregistered_images) {
    names[reason].push_back(scene.images.at(image_id).Name());
  }
  std::vector<std::string> reasons;
  for (const auto& [reason, images] : names) reasons.push_back(reason);
  std::stable_sort(
      reasons.begin(), reasons.end(), [&](const auto& a, const auto& b) {
        return names[a].size() > names[b].size();
      });
  std::vector<std::string> lines;
  for (const std::string& reason : reasons) {
    if (lines.size() == kMaxNumReasons) {
      lines.push_back("more images are not registered, see report.json");
      break;
    }
    const std::vector<std::string>& images = names[reason];
    std::string line = "not registered: ";
    for (size_t i = 0; i < std::min(images.size(), kMaxNumNames); ++i) {
      line += (i == 0 ? "" : ", ") + images[i];
    }
    if (images.size() > kMaxNumNames) {
      line += " and " + std::to_string(images.size() - kMaxNumNames) + " more";
    }
    lines.push_back(line + ": " + reason + RemedyOf(reason));
  }
  return lines;
}

// What a user should look at.
std::vector<std::string> Oddities(const Scene& scene,
                                  const DepthGlobalMapperResult& result) {
  std::vector<std::string> lines = result.warnings;
  for (const std::string& line : MissingImages(scene, result)) {
    lines.push_back(line);
  }
  if (result.models.size() > 1) {
    lines.push_back(
        "the models are apart: no pair joins them that is "
        "consistent with the others, see view_graph in " +
        std::string(kReportFile));
  }
  if (result.models.empty()) return lines;
  const auto error = MedianErrorPx(*result.models.front());
  if (error && *error > kMaxMedianErrorPx) {
    lines.push_back(
        "the median error is large: key points may be imprecise, "
        "or the camera model may not fit the lens");
  }
  if (result.units.front().unit == ModelUnit::ARBITRARY) {
    lines.push_back(
        "no depth map gives the unit: import some "
        "(depth_importer), or scale the model by known positions "
        "(model_aligner)");
  }
  return lines;
}

}  // namespace

std::string MapperSummary(const Scene& scene,
                          const DepthGlobalMapperResult& result,
                          const std::string& output_path) {
  size_t num_registered = 0;
  for (const auto& model : result.models) {
    num_registered += model->NumRegImages();
  }
  double seconds = 0;
  for (const StageReport& stage : result.stages) seconds += stage.seconds;
  std::string text =
      "registered " + std::to_string(num_registered) + " of " +
      CountText(scene.images.size(), "image") + " in " +
      CountText(result.models.size(), "model") + " in " + output_path + " (" +
      DurationText(seconds) + ", " +
      std::to_string(std::lround(
          result.stages.empty() ? 0 : result.stages.back().peak_memory_mb)) +
      " MB)\n";
  for (size_t i = 0; i < result.models.size(); ++i) {
    if (i == kMaxNumModels) {
      text += CountText(result.models.size() - i, "more model") +
              ", see report.json\n";
      break;
    }
    text += ModelText(result, i);
  }
  const std::vector<std::string> oddities = Oddities(scene, result);
  for (const std::string& line : oddities) text += "check: " + line + "\n";
  if (oddities.empty()) text += "check: nothing looks odd\n";
  return text + "report: " +
         (std::filesystem::path(output_path) / kReportFile).string() + "\n";
}

}  // namespace dgsfm
