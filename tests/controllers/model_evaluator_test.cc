#include "controllers/model_evaluator.h"

#include "tests/controllers/run_command.h"
#include "tests/testing/expect_error.h"
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

TEST(EvaluateModel, RefusesModelsWithoutCommonImage) {
  const std::string dir = CreateTestDir();
  const std::string truth = WriteText(CreateRingModel(3), dir + "/truth");
  const std::string empty = WriteText(colmap::Reconstruction(), dir + "/empty");
  colmap::Reconstruction other = CreateRingModel(3);
  for (const colmap::image_t image_id : other.RegImageIds()) {
    other.Image(image_id).SetName("sub/" + other.Image(image_id).Name());
  }
  WriteText(other, dir + "/other");
  for (const std::string& model : {empty, dir + "/other"}) {
    ExpectError([&] { EvaluateModel(model, truth, {5}); },
                {"no image of " + model, truth});
    const CommandResult result = RunForTest(&RunModelEvaluator,
                                            {"--input_path",
                                             model,
                                             "--ground_truth_path",
                                             truth,
                                             "--json_path",
                                             dir + "/result.json"});
    EXPECT_EQ(result.code, 1);
    EXPECT_EQ(result.out, "");
    EXPECT_FALSE(fs::exists(dir + "/result.json"));
  }
  EXPECT_THROW(EvaluateModel(dir + "/none", truth, {5}), std::runtime_error);
}

TEST(RunModelEvaluator, WritesTextAndJson) {
  const std::string dir = CreateTestDir();
  const std::string model = WriteText(CreateRingModel(3), dir + "/model");
  const std::string json_path = dir + "/result.json";
  const auto run = [&model](const std::string& thresholds,
                            const std::string& json) {
    return RunForTest(&RunModelEvaluator,
                      {"--input_path",
                       model,
                       "--ground_truth_path",
                       model,
                       "--thresholds",
                       thresholds,
                       "--json_path",
                       json});
  };
  const CommandResult good = run("0.5, 2", json_path);
  EXPECT_EQ(good.code, 0) << good.err;
  EXPECT_THAT(good.out, HasSubstr("Registered images: 3 of 3\n"));
  EXPECT_THAT(good.out, HasSubstr("AUC@0.5: 100.00\nAUC@2: 100.00\n"));
  nlohmann::json json;
  std::ifstream(json_path) >> json;
  EXPECT_NEAR(json.at("auc").at("0.5"), 100, 1e-3);

  for (const char* thresholds : {"", "1,,2", "0", "-1", "1;2", "x"}) {
    const CommandResult bad = run(thresholds, json_path);
    EXPECT_EQ(bad.code, 2) << thresholds;
    EXPECT_THAT(bad.err, HasSubstr("--thresholds"));
  }
  EXPECT_EQ(run("1", dir + "/none/result.json").code, 1);
}

}  // namespace
}  // namespace dgsfm
