#include "controllers/mapper_report.h"

#include "tests/testing/test_dir.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

Scene TwoImages() {
  Scene scene;
  colmap::Camera camera;
  camera.SetCameraId(1);
  camera.InitializeWithName("SIMPLE_PINHOLE", 500, 640, 480);
  scene.cameras[1] = camera;
  for (const colmap::image_t image_id : {1, 2}) {
    colmap::Image image;
    image.SetImageId(image_id);
    image.SetCameraId(1);
    image.SetName("photo \"" + std::to_string(image_id) + "\".jpg");
    scene.images[image_id] = image;
  }
  return scene;
}

PairGeometries JudgedPair() {
  PairGeometries pairs;
  PairGeometry& pair = pairs[PairIdOfImages(1, 2)];
  pair.status = PairStatus::VALID;
  pair.num_matches = 40;
  pair.inlier_matches.resize(30);
  pair.Judge(PairStage::ROTATION_AVERAGING, PairStatus::ROTATION_OUTLIER);
  return pairs;
}

nlohmann::json WrittenReport(const DepthGlobalMapperResult& result) {
  const std::string path = CreateTestDir() + "/report.json";
  WriteMapperReport(path, TwoImages(), JudgedPair(), std::nullopt, result);
  return nlohmann::json::parse(FileContent(path));
}

// The whole file, as programs that read it rely on its keys.
TEST(MapperReport, HasTheDocumentedKeys) {
  DepthGlobalMapperResult result;
  StageReport stage;
  stage.stage = "rotation_averaging";
  stage.figures = {{"images", 2}};
  stage.seconds = 0.5;
  stage.cpu_seconds = 0.75;
  stage.peak_memory_mb = 12;
  result.stages = {stage};
  result.focals[1] = {FocalSource::PAIRS, 510, 3, 0.1};
  result.unregistered_images[2] = "no valid pair: 1 rotation_outlier";
  result.depth_scales[1] = 2;
  result.warnings = {"The unit is not metres."};
  CameraResult camera;
  camera.params = {505, 320, 240};
  camera.prior_stddevs = {std::numeric_limits<double>::infinity(), 0, 0};
  camera.stddevs = {2, 0, 0};
  camera.group = 1;
  result.cameras[1] = camera;
  const nlohmann::json expected = nlohmann::json::parse(R"({
    "stages": [{"stage": "rotation_averaging", "images": 2.0, "seconds": 0.5,
                "cpu_seconds": 0.75, "peak_memory_mb": 12.0}],
    "pairs": {"rotation_outlier": 1},
    "models": [],
    "warnings": ["The unit is not metres."],
    "cameras": [{"camera_id": 1, "model": "SIMPLE_PINHOLE",
                 "intrinsics_prior": "none", "focal_source": "pairs",
                 "averaged_focal_length_px": 510.0, "num_estimates": 3,
                 "log_spread": 0.1, "prior": [500.0, 320.0, 240.0],
                 "prior_stddevs": [null, 0.0, 0.0],
                 "posterior": [505.0, 320.0, 240.0],
                 "posterior_stddevs": [2.0, 0.0, 0.0], "group": 1}],
    "images": [
      {"name": "photo \"1\".jpg", "registered": true, "depth_scale": 2.0},
      {"name": "photo \"2\".jpg", "registered": false,
       "reason": "no valid pair: 1 rotation_outlier"}],
    "view_graph": [
      {"image1": "photo \"1\".jpg", "image2": "photo \"2\".jpg",
       "status": "rotation_outlier", "num_matches": 40, "num_inliers": 30,
       "verdicts": [
         {"stage": "verification", "status": "valid"},
         {"stage": "rotation_averaging", "status": "rotation_outlier"}]}]})");
  EXPECT_EQ(WrittenReport(result), expected);
}

TEST(MapperReport, HasTheRepeatability) {
  DepthGlobalMapperResult result;
  result.repeatability = PoseMetrics();
  result.repeatability->relative_errors_deg = {0.5};
  result.repeatability->median_rotation_error_deg = 0.25;
  const nlohmann::json report = WrittenReport(result);
  // The recall rises linearly to 100 % at 0.5 degrees.
  EXPECT_NEAR(report["repeatability"]["auc_1_3_5_deg"][0], 75, 1e-9);
  EXPECT_EQ(report["repeatability"]["median_rotation_deg"], 0.25);
}

}  // namespace
}  // namespace dgsfm
