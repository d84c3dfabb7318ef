#include "controllers/model_evaluator.h"

#include "colmap_ext/model/model_io.h"
#include "colmap_ext/output_file.h"
#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"
#include "controllers/output_folder.h"

#include <iomanip>
#include <iostream>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

std::map<std::string, Rigid3d> ReadPoses(const std::string& folder) {
  std::map<std::string, Rigid3d> cam_from_world;
  for (const auto& [name, image] : ReadModelImages(folder)) {
    cam_from_world.emplace(name, image.cam_from_world);
  }
  return cam_from_world;
}

// Positive numbers separated by commas.
std::optional<std::vector<double>> ParseThresholds(const std::string& text) {
  std::vector<double> thresholds;
  std::istringstream stream(text);
  std::string item;
  while (std::getline(stream, item, ',')) {
    std::istringstream item_stream(item);
    double threshold = 0;
    if (!(item_stream >> threshold) || !(threshold > 0) ||
        item_stream.peek() != std::istringstream::traits_type::eof()) {
      return std::nullopt;
    }
    thresholds.push_back(threshold);
  }
  if (thresholds.empty()) return std::nullopt;
  return thresholds;
}

// 5 as "5", 0.5 as "0.5".
std::string ThresholdName(double threshold) {
  std::ostringstream name;
  name << threshold;
  return name.str();
}

}  // namespace

ModelEvaluation EvaluateModel(const std::string& model_path,
                              const std::string& ground_truth_path,
                              const std::vector<double>& thresholds_deg) {
  ModelEvaluation evaluation;
  evaluation.model_path = FindLargestModel(model_path);
  evaluation.num_models = FindModels(model_path).size();
  evaluation.thresholds_deg = thresholds_deg;
  const std::string truth_path = FindLargestModel(ground_truth_path);
  evaluation.metrics =
      EvaluatePoses(ReadPoses(truth_path), ReadPoses(evaluation.model_path));
  if (evaluation.metrics.num_registered == 0) {
    throw std::runtime_error(
        "no image of " + evaluation.model_path + " has the name of one of " +
        truth_path + ": images are compared by name, with the folders in it");
  }
  evaluation.auc =
      AreaUnderCurve(evaluation.metrics.relative_errors_deg, thresholds_deg);
  return evaluation;
}

std::string ToText(const ModelEvaluation& evaluation) {
  const PoseMetrics& metrics = evaluation.metrics;
  std::ostringstream text;
  text << "Model: " << evaluation.model_path << " (largest of "
       << evaluation.num_models << " at the path)\n"
       << "Registered images: " << metrics.num_registered << " of "
       << metrics.num_images << "\n";
  for (size_t i = 0; i < evaluation.auc.size(); ++i) {
    text << "AUC@" << ThresholdName(evaluation.thresholds_deg[i]) << ": "
         << std::fixed << std::setprecision(2) << evaluation.auc[i]
         << std::defaultfloat << "\n";
  }
  text << std::setprecision(5)
       << "Median rotation error [deg]: " << metrics.median_rotation_error_deg
       << "\nMedian translation direction error [deg]: "
       << metrics.median_translation_error_deg
       << "\nScale (truth / model): " << metrics.truth_from_model_scale
       << "\nRMS centre error after alignment [truth units]: "
       << metrics.rms_center_error
       << "\nMax centre error after alignment [truth units]: "
       << metrics.max_center_error << "\n";
  return text.str();
}

nlohmann::json ToJson(const ModelEvaluation& evaluation) {
  const PoseMetrics& metrics = evaluation.metrics;
  nlohmann::json auc = nlohmann::json::object();
  for (size_t i = 0; i < evaluation.auc.size(); ++i) {
    auc[ThresholdName(evaluation.thresholds_deg[i])] = evaluation.auc[i];
  }
  return {
      {"model_path", evaluation.model_path},
      {"num_models", evaluation.num_models},
      {"num_images", metrics.num_images},
      {"num_registered", metrics.num_registered},
      {"auc", auc},
      {"median_rotation_error_deg", metrics.median_rotation_error_deg},
      {"median_translation_error_deg", metrics.median_translation_error_deg},
      {"truth_from_model_scale", metrics.truth_from_model_scale},
      {"rms_center_error", metrics.rms_center_error},
      {"max_center_error", metrics.max_center_error}};
}

int RunModelEvaluator(int argc, char** argv) {
  std::string input_path, ground_truth_path, json_path;
  std::string thresholds_deg = "1,3,5,10";
  CommandOptions options("model_evaluator",
                         "Compare camera poses with ground truth.");
  options.AddRequired(
      "input_path", &input_path, "Model folder, or folder of models.");
  options.AddRequired("ground_truth_path",
                      &ground_truth_path,
                      "Model folder with the true poses.");
  options.Add("thresholds",
              &thresholds_deg,
              "Errors up to which to compute the area under the recall curve "
              "[deg], separated by commas.");
  options.Add("json_path", &json_path, "Where to write the result as JSON.");
  if (const auto code = options.Parse(argc, argv)) return *code;
  const auto thresholds = ParseThresholds(thresholds_deg);
  if (!thresholds) {
    std::cerr << "ERROR: --thresholds must be positive numbers separated by "
                 "commas, not '"
              << thresholds_deg << "'" << std::endl;
    return 2;
  }

  const ModelEvaluation evaluation =
      EvaluateModel(input_path, ground_truth_path, *thresholds);
  std::cout << ToText(evaluation) << std::flush;
  if (!json_path.empty()) {
    WriteFile(json_path, JsonText(ToJson(evaluation), 2) + "\n");
  }
  return 0;
}

}  // namespace dgsfm
