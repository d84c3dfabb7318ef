// Models by the positions of their images, as a user gets them.

#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/local_frame.h"
#include "colmap_ext/model/model_io.h"
#include "colmap_ext/synthetic/position_noise.h"
#include "controllers/commands/commands.h"
#include "controllers/model_evaluator.h"
#include "controllers/pose_prior_loader.h"
#include "estimators/median.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/test_dir.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

std::string ReadText(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class GeoreferencingTest : public testing::Test {
 protected:
  void SetUp() override { dir_ = CreateTestDir(); }

  void Synthesize(const std::vector<std::string>& arguments) {
    std::vector<std::string> all = {"--family",
                                    "street",
                                    "--num_points_per_image",
                                    "120",
                                    "--depth_model",
                                    "exact"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    path_ = SynthesizeDatabase(dir_, all);
  }

  CommandResult Map(const std::vector<std::string>& arguments = {}) const {
    std::vector<std::string> all = {"--database_path",
                                    path_,
                                    "--output_path",
                                    dir_ + "/models",
                                    "--num_threads",
                                    "1"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return RunForTest(&RunDepthGlobalMapper, all);
  }

  nlohmann::json Report() const {
    return nlohmann::json::parse(std::ifstream(dir_ + "/models/report.json"));
  }

  std::string dir_;
  std::string path_;
};

// Halves of a street that share no match, with a wrong position in each ten.
TEST_F(GeoreferencingTest, UnconnectedHalvesBecomeOneModelInMetres) {
  Synthesize({"--num_images",
              "40",
              "--num_components",
              "2",
              "--gps",
              "1",
              "--gps_noise",
              "0.2",
              "--gravity",
              "1",
              "--gps_altitude_offset",
              "30",
              "--gps_outlier_ratio",
              "0.1",
              "--component_step",
              "120"});
  const auto result = Map();
  ASSERT_EQ(result.code, 0);
  const auto report = Report();
  ASSERT_EQ(report["models"].size(), 1);
  EXPECT_EQ(report["models"][0]["images"], 40);
  const auto& positions = report["models"][0]["positions"];
  EXPECT_TRUE(positions["georeferenced"]);
  EXPECT_EQ(positions["parts_without_common_matches"].size(), 2);
  EXPECT_EQ(positions["images_with_position"], 40);
  EXPECT_GE(positions["inliers"], 34);
  EXPECT_NE(result.out.find("unit metres"), std::string::npos);

  const auto georeference =
      nlohmann::json::parse(std::ifstream(dir_ + "/models/georeference.json"));
  const auto& origin = georeference["origin"];
  const LocalFrame frame(
      {origin["latitude_deg"], origin["longitude_deg"], origin["altitude_m"]});
  const auto truth = ReadModelImages(dir_ + "/scene/gt");
  const auto model = ReadModelImages(dir_ + "/models/0");
  ASSERT_EQ(model.size(), 40);
  std::vector<double> errors;
  for (const auto& [name, image] : model) {
    const Eigen::Vector3d in_truth = SyntheticFrame().FromGeodetic(
        frame.ToGeodetic(image.cam_from_world.TargetOriginInSource()));
    errors.push_back((in_truth - Eigen::Vector3d(0, 0, 30) -
                      truth.at(name).cam_from_world.TargetOriginInSource())
                         .norm());
  }
  // The noise of a position is 0.35 m in all.
  EXPECT_LT(Median(errors), 0.2);
}

// Positions are those of images, poses those of frames.
TEST_F(GeoreferencingTest, StereoRigIsAtItsPositions) {
  Synthesize({"--num_images",
              "48",
              "--rig",
              "stereo",
              "--gps",
              "1",
              "--gps_noise",
              "0.2",
              "--gps_outlier_ratio",
              "0.1",
              "--gravity",
              "1"});
  const std::vector<std::string> with_rig = {"--rig_config_path",
                                             dir_ + "/scene/rig_config.json"};
  for (const bool refine : {false, true}) {
    std::vector<std::string> arguments = with_rig;
    arguments.insert(
        arguments.end(),
        {"--DepthGlobalMapper.refine_sensor_from_rig", refine ? "1" : "0"});
    ASSERT_EQ(Map(arguments).code, 0);
    const auto report = Report();
    ASSERT_EQ(report["models"].size(), 1);
    EXPECT_EQ(report["models"][0]["images"], 48);
    const auto& positions = report["models"][0]["positions"];
    EXPECT_TRUE(positions["georeferenced"]);
    EXPECT_EQ(positions["scale_source"], refine ? "positions" : "rigs");
    // The noise of a position is 0.28 m horizontally.
    EXPECT_LT(positions["median_horizontal_error_m"], 0.5);
    const auto model = ReadModelImages(dir_ + "/models/0");
    std::vector<double> baselines;
    for (const auto& [name, image] : model) {
      if (name.rfind("cam0", 0) != 0) continue;
      const auto& other = model.at("cam1" + name.substr(4));
      baselines.push_back((image.cam_from_world.TargetOriginInSource() -
                           other.cam_from_world.TargetOriginInSource())
                              .norm());
      if (refine) continue;
      // A fixed rig is rigid.
      EXPECT_NEAR(baselines.back(), 0.5, 1e-9);
    }
    EXPECT_NEAR(Median(baselines), 0.5, 0.02);
  }
}

// Each half gets cameras of its own, and with these a rig of its own.
TEST_F(GeoreferencingTest, UnconnectedHalvesOfARigBecomeOneModel) {
  Synthesize({"--num_images",
              "48",
              "--rig",
              "stereo",
              "--num_components",
              "2",
              "--component_step",
              "120",
              "--gps",
              "1",
              "--gps_noise",
              "0.2",
              "--gravity",
              "1"});
  for (const char* refine : {"0", "1"}) {
    const auto result = Map({"--rig_config_path",
                             dir_ + "/scene/rig_config.json",
                             "--DepthGlobalMapper.refine_sensor_from_rig",
                             refine});
    ASSERT_EQ(result.code, 0);
    const auto report = Report();
    ASSERT_EQ(report["models"].size(), 1) << refine;
    EXPECT_EQ(report["models"][0]["images"], 48);
    EXPECT_EQ(
        report["models"][0]["positions"]["parts_without_common_matches"].size(),
        2);
    // The noise of a position is 0.28 m horizontally.
    EXPECT_LT(report["models"][0]["positions"]["median_horizontal_error_m"],
              0.5);
    EXPECT_EQ(ReadModelCameras(dir_ + "/models/0").size(), 4);
    // Rigs of two sensors each: id, number, type and id of the reference, and
    // type, id, flag and seven numbers of the other; after the number of rigs.
    constexpr size_t kRigSize = 4 + 4 + 8 + 8 + 1 + 7 * 8;
    EXPECT_EQ(ReadText(dir_ + "/models/0/rigs.bin").size(), 8 + 2 * kRigSize);
  }
}

// Baselines in decimetres.
TEST_F(GeoreferencingTest, NamesRigsInAnotherUnitThanPositions) {
  Synthesize({"--num_images", "48", "--rig", "stereo", "--gps", "1"});
  const std::string path = dir_ + "/scene/rig_config.json";
  auto config = nlohmann::json::parse(std::ifstream(path));
  config[0]["cameras"][1]["cam_from_rig_translation"][0] = -5;
  std::ofstream(path) << config;
  const auto result = Map({"--rig_config_path", path});
  ASSERT_EQ(result.code, 0);
  EXPECT_FALSE(Report()["models"][0].contains("positions"));
  EXPECT_EQ(Report()["models"][0]["unit"], "rigs");
  EXPECT_NE(result.out.find("the baselines of the rigs would have to be "
                            "multiplied with 0.1"),
            std::string::npos)
      << result.out;
}

// Baselines in millimetres.
TEST_F(GeoreferencingTest, NamesRigsInAnotherUnitThanDepth) {
  Synthesize({"--num_images", "24", "--rig", "stereo"});
  const std::string path = dir_ + "/scene/rig_config.json";
  const std::string warning =
      "differ from the baselines of its rigs by a factor";
  EXPECT_EQ(Map({"--rig_config_path", path}).out.find(warning),
            std::string::npos);
  auto config = nlohmann::json::parse(std::ifstream(path));
  config[0]["cameras"][1]["cam_from_rig_translation"][0] = -500;
  std::ofstream(path) << config;
  const auto result = Map({"--rig_config_path", path});
  ASSERT_EQ(result.code, 0);
  EXPECT_EQ(Report()["models"][0]["unit"], "rigs");
  EXPECT_NE(result.out.find(warning), std::string::npos) << result.out;
}

TEST_F(GeoreferencingTest, ModelsStandUprightByGravityAndOnRequestByCameras) {
  Synthesize(
      {"--num_images", "12", "--gravity", "1", "--gravity_noise", "0.5"});
  // Median cosine of the angle between z and what the cameras have upwards.
  const auto uprightness = [&] {
    std::vector<double> cosines;
    for (const auto& [name, image] : ReadModelImages(dir_ + "/models/0")) {
      cosines.push_back(
          (image.cam_from_world.rotation * Eigen::Vector3d::UnitZ())
              .dot(-Eigen::Vector3d::UnitY()));
    }
    return Median(cosines);
  };
  ASSERT_EQ(Map().code, 0);
  // Cameras look ahead, a little down.
  EXPECT_GT(uprightness(), 0.95);
  const std::string by_gravity = ReadText(dir_ + "/models/0/images.bin");
  ASSERT_EQ(Map({"--use_pose_priors", "0"}).code, 0);
  const std::string as_it_is = ReadText(dir_ + "/models/0/images.bin");
  EXPECT_NE(by_gravity, as_it_is);
  ASSERT_EQ(Map({"--upright", "0"}).code, 0);
  EXPECT_EQ(ReadText(dir_ + "/models/0/images.bin"), as_it_is);
  ASSERT_EQ(
      Map({"--use_pose_priors", "0", "--upright_by_level_cameras", "1"}).code,
      0);
  EXPECT_GT(uprightness(), 0.95);
}

TEST_F(GeoreferencingTest, InfinitelyUncertainPositionsChangeNothing) {
  Synthesize({"--num_images", "12", "--gps", "1"});
  ASSERT_EQ(Map({"--use_pose_priors", "0"}).code, 0);
  const std::string without = ReadText(dir_ + "/models/0/images.bin");
  const SqliteConnection connection(path_, SqliteConnection::Mode::READ_WRITE);
  const std::vector<double> infinite(9,
                                     std::numeric_limits<double>::infinity());
  SqliteStatement(connection, "UPDATE pose_priors SET position_covariance = ?")
      .Bind(infinite)
      .Run();
  ASSERT_EQ(Map().code, 0);
  EXPECT_EQ(ReadText(dir_ + "/models/0/images.bin"), without);
  EXPECT_FALSE(without.empty());
}

TEST_F(GeoreferencingTest, ReadsPositionsOfAllSources) {
  Synthesize({"--num_images", "6"});
  const Scene scene = ReadScene(path_);
  const auto load = [&](const PosePriorOptions& options) {
    return LoadPosePriors(options, path_, "", scene);
  };
  EXPECT_TRUE(load({}).priors.empty());

  // COLMAP 3.8.
  const SqliteConnection connection(path_, SqliteConnection::Mode::READ_WRITE);
  connection.Execute(
      "UPDATE images SET prior_tx = 48 + 0.001 * image_id, prior_ty = 11, "
      "prior_tz = 500");
  EXPECT_EQ(load({}).priors.size(), 6);
  EXPECT_NEAR(
      load({}).priors.at(2).position.y() - load({}).priors.at(1).position.y(),
      111.2,
      0.1);

  // COLMAP 3.11, and the text file, which comes first.
  connection.Execute(
      "CREATE TABLE pose_priors (image_id INTEGER PRIMARY KEY NOT NULL, "
      "position BLOB, coordinate_system INTEGER NOT NULL, "
      "position_covariance BLOB)");
  SqliteStatement(connection,
                  "INSERT INTO pose_priors SELECT image_id, ?, 1, NULL FROM "
                  "images WHERE image_id < 4")
      .Bind(std::vector<double>{1, 2, 3})
      .Run();
  SqliteStatement(connection,
                  "UPDATE pose_priors SET position = ? WHERE image_id = 1")
      .Bind(std::vector<double>{4, 5, 6})
      .Run();
  EXPECT_FALSE(load({}).frame);
  EXPECT_EQ(load({}).priors.size(), 3);
  EXPECT_EQ(load({}).priors.at(1).position, Eigen::Vector3d(4, 5, 6));
  PosePriorOptions options;
  options.path = dir_ + "/positions.txt";
  options.coordinates = "cartesian";
  std::ofstream(options.path)
      << "# name x y z\nimage0000.jpg 7 8 9 0.1 0.2\n\nother.jpg 1 2 3\n";
  EXPECT_EQ(load(options).priors.at(1).position, Eigen::Vector3d(7, 8, 9));
  EXPECT_NEAR(load(options).priors.at(1).covariance(2, 2), 0.04, 1e-12);
  EXPECT_EQ(load(options).priors.size(), 3);

  std::ofstream(options.path) << "image0000.jpg 7 8 9\nimage0001.jpg 7 x 9\n";
  ExpectError([&] { load(options); },
              "positions.txt, line 2: 'x' is no number");
  SqliteStatement(connection, "UPDATE pose_priors SET position = x'00'").Run();
  ExpectError([&] { load({}); }, "image0000.jpg");
}

TEST_F(GeoreferencingTest, NamesWhatIsWrongWithPositions) {
  Synthesize({"--num_images", "6"});
  const Scene scene = ReadScene(path_);
  PosePriorOptions options;
  options.path = dir_ + "/positions.txt";
  const auto warnings = [&](const std::string& text) {
    std::ofstream(options.path) << text;
    const auto loaded = LoadPosePriors(options, path_, "", scene);
    std::string all;
    for (const std::string& warning : loaded.warnings) all += warning + "\n";
    return all;
  };
  EXPECT_EQ(warnings("image0000.jpg 48 11 5\nimage0001.jpg 48.1 11 5\n"), "");
  EXPECT_THAT(warnings("image0000.jpg 48 11 -\nimage0001.jpg 48.1 11 5\n"),
              testing::HasSubstr("image image0000.jpg, have no altitude"));
  EXPECT_THAT(warnings("image0000.jpg 111 48 5\nimage0001.jpg 48 11 5\n"),
              testing::HasSubstr("latitude and longitude may be swapped"));
  EXPECT_THAT(warnings("image0000.jpg 0 0 0\nimage0001.jpg 48 11 5\n"),
              testing::HasSubstr("receivers without a fix"));
  EXPECT_THAT(warnings("image0000.jpg 48 11 5\nimage0001.jpg 48 11 6\n"),
              testing::HasSubstr("all the same"));
}

TEST_F(GeoreferencingTest, RefusesFilesOfPositionsThatServeNoImage) {
  Synthesize({"--num_images", "6", "--gps", "1"});
  const Scene scene = ReadScene(path_);
  PosePriorOptions options;
  options.path = dir_ + "/positions.txt";
  const auto load = [&](const std::string& text) {
    std::ofstream(options.path) << text;
    return LoadPosePriors(options, path_, "", scene);
  };
  ExpectError([&] { load(""); }, options.path + " has no line 'name a b c'");
  ExpectError([&] { load("# name\n"); }, "positions.txt has no line");
  ExpectError([&] { load("b.jpg 48 11 5\nc.jpg 48 11 5\n"); },
              {options.path, "the first is b.jpg", "such as image0000.jpg"});
  ExpectError([&] { load("image0000.jpg 48 11 1e9\n"); },
              "positions.txt, line 1: image image0000.jpg would be at altitude "
              "1e9 m");
  ExpectError([&] { load("image0000.jpg 48 11 -13000\n"); }, "-13000 m");
  // The byte order mark of editors on Windows.
  const auto loaded =
      load("\xef\xbb\xbfimage0000.jpg 48 11 5 3 4\nimage0001.jpg 48.1 11 5\n");
  EXPECT_NEAR(loaded.priors.at(1).covariance(2, 2), 16, 1e-9);
  options.coordinates = "cartesian";
  ExpectError([&] { load("image0000.jpg 48 11 1e9\n"); },
              "would be at 48 11 1e9 m, which is not near the earth");
}

// Altitudes of receivers are no error of the user.
TEST_F(GeoreferencingTest, LeavesImpossibleAltitudesOfTheDatabaseOut) {
  Synthesize({"--num_images", "6"});
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute(
          "UPDATE images SET prior_tx = 48 + 0.001 * image_id, prior_ty = 11, "
          "prior_tz = 500 + 1e7 * (image_id = 3)");
  const auto loaded = LoadPosePriors({}, path_, "", ReadScene(path_));
  EXPECT_EQ(loaded.priors.size(), 5);
  EXPECT_THAT(loaded.warnings,
              testing::ElementsAre(testing::HasSubstr(
                  "of image image0002.jpg, are not near the earth")));
}

TEST(LocalFrame, GoesThereAndBack) {
  const LocalFrame frame({48, 11, 500});
  EXPECT_NEAR(frame.FromGeodetic({48, 11, 507}).z(), 7, 1e-6);
  // A degree of longitude on the equator.
  EXPECT_NEAR(
      LocalFrame({0, 0, 0}).FromGeodetic({0, 0.001, 0}).x(), 111.3195, 1e-4);
  const Eigen::Vector3d local(300, -200, 40);
  EXPECT_LT((frame.FromGeodetic(frame.ToGeodetic(local)) - local).norm(), 1e-6);
}

}  // namespace
}  // namespace dgsfm
