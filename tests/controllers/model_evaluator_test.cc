#include "controllers/model_evaluator.h"

#include "controllers/commands.h"
#include "tests/testing/ring_model.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

using testing::HasSubstr;

std::string WriteText(const colmap::Reconstruction& model,
                      const std::string& folder) {
  fs::create_directories(folder);
  model.WriteText(folder);
  return folder;
}

TEST(EvaluateModel, LargestModelCountsAndMissingImageFails) {
  const std::string dir = CreateTestDir();
  const std::string truth = WriteText(CreateRingModel(4), dir + "/truth");
  fs::remove(truth + "/points3D.txt");
  fs::remove(truth + "/cameras.txt");
  WriteText(CreateRingModel(2), dir + "/model/0");
  colmap::Reconstruction model = CreateRingModel(4);
  model.DeRegisterImage(2);
  fs::create_directories(dir + "/model/1");
  model.WriteBinary(dir + "/model/1");

  const ModelEvaluation evaluation =
      EvaluateModel(dir + "/model", truth, {1, 5});
  EXPECT_EQ(evaluation.model_path, dir + "/model/1");
  EXPECT_EQ(evaluation.num_models, 2);
  EXPECT_EQ(evaluation.metrics.num_images, 4);
  EXPECT_EQ(evaluation.metrics.num_registered, 3);
  // Three of six pairs are exact up to 1e-6 deg.
  EXPECT_NEAR(evaluation.auc[0], 50, 1e-3);
  EXPECT_NEAR(evaluation.auc[1], 50, 1e-3);
}

TEST(EvaluateModel, SimilarityIsPerfectAndItsScaleIsFound) {
  const std::string dir = CreateTestDir();
  const std::string truth = WriteText(CreateRingModel(6), dir + "/truth");
  colmap::Reconstruction moved = CreateRingModel(6);
  moved.Transform(colmap::SimilarityTransform3(
      0.5, Eigen::Vector4d(0.5, 0.5, -0.5, 0.5), Eigen::Vector3d(1, 2, 3)));
  const ModelEvaluation evaluation =
      EvaluateModel(WriteText(moved, dir + "/moved"), truth, {1});
  EXPECT_NEAR(evaluation.auc[0], 100, 1e-3);
  EXPECT_NEAR(evaluation.metrics.truth_from_model_scale, 2, 1e-10);
  EXPECT_NEAR(evaluation.metrics.max_center_error, 0, 1e-10);

  const nlohmann::json json = ToJson(evaluation);
  EXPECT_EQ(json.at("auc").at("1"), evaluation.auc[0]);
  EXPECT_EQ(json.at("num_registered"), 6);
  EXPECT_EQ(json.at("truth_from_model_scale"),
            evaluation.metrics.truth_from_model_scale);
  EXPECT_THAT(ToText(evaluation), HasSubstr("AUC@1: 100.00\n"));
}

TEST(EvaluateModel, ModelWithoutCommonOrAnyImageScoresZero) {
  const std::string dir = CreateTestDir();
  const std::string truth = WriteText(CreateRingModel(3), dir + "/truth");
  const std::string empty = WriteText(colmap::Reconstruction(), dir + "/empty");
  const ModelEvaluation evaluation = EvaluateModel(empty, truth, {5});
  EXPECT_EQ(evaluation.auc[0], 0);
  EXPECT_EQ(evaluation.metrics.num_registered, 0);
  EXPECT_THROW(EvaluateModel(dir + "/none", truth, {5}), std::runtime_error);
}

TEST(RunModelEvaluator, WritesTextAndJson) {
  const std::string dir = CreateTestDir();
  const std::string model = WriteText(CreateRingModel(3), dir + "/model");
  const std::string json_path = dir + "/result.json";
  const auto run = [&](std::string thresholds, std::string json) {
    std::vector<std::string> arguments = {"colmap",
                                          "--input_path",
                                          model,
                                          "--ground_truth_path",
                                          model,
                                          "--thresholds",
                                          thresholds,
                                          "--json_path",
                                          json};
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    const int code = RunCommand(
        {"model_evaluator", "", &RunModelEvaluator}, argv.size(), argv.data());
    return std::make_tuple(code,
                           testing::internal::GetCapturedStdout(),
                           testing::internal::GetCapturedStderr());
  };
  const auto [code, text, log] = run("0.5, 2", json_path);
  EXPECT_EQ(code, 0) << log;
  EXPECT_THAT(text, HasSubstr("Registered images: 3 of 3\n"));
  EXPECT_THAT(text, HasSubstr("AUC@0.5: 100.00\nAUC@2: 100.00\n"));
  nlohmann::json json;
  std::ifstream(json_path) >> json;
  EXPECT_NEAR(json.at("auc").at("0.5"), 100, 1e-3);

  for (const char* thresholds : {"", "1,,2", "0", "-1", "1;2", "x"}) {
    const auto [bad_code, bad_text, bad_log] = run(thresholds, json_path);
    EXPECT_EQ(bad_code, 2) << thresholds;
    EXPECT_THAT(bad_log, HasSubstr("--thresholds"));
  }
  EXPECT_EQ(std::get<0>(run("1", dir + "/none/result.json")), 1);
}

}  // namespace
}  // namespace dgsfm
