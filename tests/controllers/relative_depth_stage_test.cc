#include "controllers/relative_depth_stage.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/affine_depth.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/test_dir.h"

#include <cmath>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

// A ring whose depths become disparities of 8 bits with a scale and shift of
// their own per image.
class RelativeDepthStage : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    path_ = SynthesizeDatabase(dir_,
                               {"--num_images",
                                "12",
                                "--num_points_per_image",
                                "300",
                                "--depth_model",
                                "exact"});
    DepthDatabase database(path_, DepthDatabase::Mode::READ_WRITE);
    given_ = database.ReadAllKeypointDepths();
    for (auto& [image_id, depths] : given_) {
      const double scale = 100 + 20 * image_id;
      const double shift = -40 + 10 * double(image_id);
      shifts_[image_id] = shift;
      KeypointDepths relative = depths;
      relative.unit = DepthUnit::AFFINE_DISPARITY;
      for (float& depth : relative.depths) {
        if (depth > 0) depth = float(std::round(scale / depth + shift));
      }
      database.WriteKeypointDepths(image_id, relative);
    }
    options_.database_path = path_;
    options_.verification.num_threads = 1;
  }

  RelativeDepths Convert(KeypointDepthMap* depths) {
    Scene scene = ReadScene(path_);
    std::vector<StageReport> stages;
    *depths = LoadDepths(options_, scene, &stages);
    return ConvertRelativeDepths(options_, &scene, depths, &stages);
  }

  // The report of the mapper.
  nlohmann::json MapDatabase() {
    const std::vector<std::string> arguments = {"--database_path",
                                                path_,
                                                "--output_path",
                                                dir_ + "/models",
                                                "--num_threads",
                                                "1"};
    EXPECT_EQ(RunForTest(&RunDepthGlobalMapper, arguments).code, 0);
    return nlohmann::json::parse(std::ifstream(dir_ + "/models/report.json"));
  }

  std::string dir_;
  std::string path_;
  DepthGeometricVerifierOptions options_;
  KeypointDepthMap given_;
  std::map<colmap::image_t, double> shifts_;
};

TEST_F(RelativeDepthStage, MapsBecomeDepthUpToAFactor) {
  KeypointDepthMap depths;
  const RelativeDepths relative = Convert(&depths);
  EXPECT_EQ(relative.fits.size(), given_.size());
  ASSERT_EQ(relative.conversions.size(), given_.size());
  for (const auto& [image_id, fit] : relative.fits) {
    EXPECT_NEAR(fit.fit.shift, shifts_.at(image_id), 4 * fit.fit.shift_stddev)
        << image_id;
    EXPECT_EQ(depths.at(image_id).unit, DepthUnit::RELATIVE);
  }
}

TEST_F(RelativeDepthStage, MapsOfTheOtherKindAreNotUsed) {
  DepthDatabase database(path_, DepthDatabase::Mode::READ_WRITE);
  for (auto& [image_id, depths] : given_) {
    depths.unit = DepthUnit::AFFINE_DISPARITY;
    database.WriteKeypointDepths(image_id, depths);
  }
  KeypointDepthMap depths;
  const RelativeDepths relative = Convert(&depths);
  EXPECT_TRUE(relative.conversions.empty());
  EXPECT_TRUE(depths.empty());
  EXPECT_LT(relative.fits.begin()->second.fit.concordance, 0);
}

TEST_F(RelativeDepthStage, MapperTakesTheStoredPairsOfTheVerifier) {
  VerifyDatabasePairs(options_);
  const nlohmann::json report = MapDatabase();
  for (const auto& stage : report["stages"]) {
    if (stage["stage"] == "pair_verification") {
      EXPECT_EQ(stage["kept"], report["view_graph"].size());
    }
  }
  EXPECT_EQ(report["models"][0]["unit"], "depth_maps");
  for (const auto& image : report["images"]) {
    EXPECT_EQ(image["relative_depth"]["used"], true);
    EXPECT_GT(image["relative_depth"]["by_model"]["scale"], 0);
  }
  EXPECT_TRUE(report["warnings"].empty()) << report["warnings"];
}

TEST_F(RelativeDepthStage, MapperNamesTheKindThatFits) {
  DepthDatabase database(path_, DepthDatabase::Mode::READ_WRITE);
  for (auto& [image_id, depths] : given_) {
    for (float& depth : depths.depths) {
      if (depth > 0) depth = 1 / depth;
    }
    database.WriteKeypointDepths(image_id, depths);
  }
  const nlohmann::json report = MapDatabase();
  EXPECT_THAT(report["warnings"].dump(),
              testing::HasSubstr("--depth_type relative_disparity"));
  for (const auto& stage : report["stages"]) {
    if (stage["stage"] == "depth_reliability") {
      EXPECT_EQ(stage["maps_dropped"], given_.size());
    }
  }
}

}  // namespace
}  // namespace dgsfm
