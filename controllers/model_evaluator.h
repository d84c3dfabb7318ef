// `model_evaluator`: pose accuracy of a model on disk against ground truth.

#pragma once

#include "estimators/pose_metrics.h"

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace dgsfm {

struct ModelEvaluation {
  std::string model_path;  // of the model with most images
  size_t num_models = 0;   // at the given path
  std::vector<double> thresholds_deg;
  std::vector<double> auc;  // one per threshold [per cent]
  PoseMetrics metrics;
};

// Each path is a model folder or a folder of models (see FindModels), of which
// the one with most images counts. Images are matched by name.
// Throws std::runtime_error if one of the models cannot be read, or if they
// have no image in common.
ModelEvaluation EvaluateModel(const std::string& model_path,
                              const std::string& ground_truth_path,
                              const std::vector<double>& thresholds_deg);

std::string ToText(const ModelEvaluation& evaluation);
nlohmann::json ToJson(const ModelEvaluation& evaluation);

}  // namespace dgsfm
