#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/model/model_io.h"
#include "controllers/commands/commands.h"
#include "controllers/model_evaluator.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/test_dir.h"

#include <colmap/util/bitmap.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// A ring of twelve images with two pairs that are not true.
class GlobalDepthMapperTest : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    path_ = SynthesizeDatabase(dir_,
                               {"--num_images",
                                "12",
                                "--num_points_per_image",
                                "120",
                                "--num_false_pairs",
                                "2"});
  }

  int Map(const std::vector<std::string>& arguments = {}) const {
    std::vector<std::string> all = {"--database_path",
                                    path_,
                                    "--output_path",
                                    dir_ + "/models",
                                    "--num_threads",
                                    "1"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return RunForTest(&RunDepthGlobalMapper, all).code;
  }

  std::map<colmap::image_pair_t, PairStatus> StoredStatuses() const {
    return DepthDatabase(path_, DepthDatabase::Mode::READ_ONLY)
        .ReadPairStatuses();
  }

  std::string dir_;
  std::string path_;
};

TEST_F(GlobalDepthMapperTest, EveryPairSaysWhatBecameOfIt) {
  EXPECT_TRUE(StoredStatuses().empty());
  ASSERT_EQ(Map(), 0);
  const auto report =
      nlohmann::json::parse(std::ifstream(dir_ + "/models/report.json"));
  const Scene scene = ReadScene(path_);
  const auto statuses = StoredStatuses();
  ASSERT_EQ(report["view_graph"].size(), scene.matches.size());
  ASSERT_EQ(statuses.size(), scene.matches.size());
  size_t i = 0, num_outliers = 0;
  for (const auto& [pair_id, status] : statuses) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto& entry = report["view_graph"][i++];
    EXPECT_EQ(entry["image1"], scene.images.at(image_id1).Name());
    EXPECT_EQ(entry["image2"], scene.images.at(image_id2).Name());
    EXPECT_EQ(entry["status"], PairStatusName(status));
    EXPECT_EQ(entry["num_matches"], scene.matches.at(pair_id).size());
    num_outliers += status == PairStatus::ROTATION_OUTLIER;
  }
  // Exact pairs but for the two false ones.
  EXPECT_EQ(num_outliers, 2);
  EXPECT_EQ(report["pairs"]["valid"], scene.matches.size() - 2);
}

TEST_F(GlobalDepthMapperTest, RunsAgainFromTheSamePairs) {
  ASSERT_EQ(Map(), 0);
  const auto first = StoredStatuses();
  ASSERT_EQ(Map(), 0);
  EXPECT_EQ(StoredStatuses(), first);
}

TEST_F(GlobalDepthMapperTest, ReplacesWhatAnEarlierRunWrote) {
  const std::string models = dir_ + "/models";
  ASSERT_EQ(Map(), 0);
  // A run that gave two models, by its own account.
  fs::copy(models + "/0", models + "/1");
  std::ofstream(models + "/.dgsfm_manifest", std::ios::app)
      << "1/cameras.bin\n1/images.bin\n1/points3D.bin\n\n..\nnotes.txt\n";
  std::ofstream(models + "/notes.txt") << "of the user";
  // Links are replaced, what they lead to stays.
  fs::remove(models + "/report.json");
  fs::create_symlink("notes.txt", models + "/report.json");
  ASSERT_EQ(Map(), 0);
  EXPECT_FALSE(fs::is_symlink(models + "/report.json"));
  EXPECT_EQ(FileContent(models + "/notes.txt"), "of the user");
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(models)) {
    names.push_back(entry.path().filename().string());
  }
  EXPECT_THAT(
      names,
      testing::UnorderedElementsAre(
          "0", "project.ini", "report.json", "notes.txt", ".dgsfm_manifest"));
}

TEST_F(GlobalDepthMapperTest, WritesThePageOfTheReport) {
  const std::string page = dir_ + "/models/report.html";
  ASSERT_EQ(Map(), 0);
  EXPECT_FALSE(fs::exists(page));
  ASSERT_EQ(Map({"--write_html_report", "1"}), 0);
  EXPECT_THAT(FileContent(page), testing::HasSubstr("\"title\":\"models\""));
  // It is gone with the run that it shows.
  ASSERT_EQ(Map(), 0);
  EXPECT_FALSE(fs::exists(page));

  for (const auto& [image_id, image] : ReadScene(path_).images) {
    colmap::Bitmap bitmap;
    bitmap.Allocate(8, 6, true);
    ASSERT_TRUE(bitmap.Write(dir_ + "/" + image.Name()));
  }
  ASSERT_EQ(Map({"--image_path", dir_, "--write_html_report", "0"}), 0);
  EXPECT_FALSE(fs::exists(page));
  ASSERT_EQ(Map({"--image_path", dir_}), 0);
  EXPECT_THAT(FileContent(page), testing::HasSubstr("\"thumbnail\":\"/9j/"));
}

// A page that was made later is no file of somebody else's.
TEST_F(GlobalDepthMapperTest, ReplacesThePageOfTheReporter) {
  const std::string page = dir_ + "/models/report.html";
  ASSERT_EQ(Map(), 0);
  EXPECT_EQ(
      RunForTest(&RunModelReporter,
                 {"--input_path", dir_ + "/models", "--output_path", page})
          .code,
      0);
  EXPECT_TRUE(fs::exists(page));
  EXPECT_EQ(Map(), 0);
  EXPECT_FALSE(fs::exists(page));
}

TEST_F(GlobalDepthMapperTest, TouchesNothingItDidNotWrite) {
  const std::string models = dir_ + "/models";
  for (const std::string file :
       {"0/images.bin", "7/other.txt", "project.ini", "report.json"}) {
    fs::create_directories(fs::path(models + "/" + file).parent_path());
    std::ofstream(models + "/" + file) << "of the user";
    const CommandResult result =
        RunForTest(&RunDepthGlobalMapper,
                   {"--database_path", path_, "--output_path", models});
    EXPECT_EQ(result.code, 1);
    EXPECT_THAT(result.err,
                testing::HasSubstr(models + "/" + file + " is in the way"));
    EXPECT_EQ(FileContent(models + "/" + file), "of the user");
    fs::remove_all(models);
  }
}

TEST_F(GlobalDepthMapperTest, NamesAreCheckedOrWritten) {
  const SqliteConnection connection(path_, SqliteConnection::Mode::READ_WRITE);
  connection.Execute(
      "UPDATE images SET name = CAST(x'e92e6a7067' AS TEXT) "
      "WHERE image_id = 2");
  ASSERT_EQ(Map(), 0);
  EXPECT_EQ(ReadModelImages(dir_ + "/models/0").count("\xe9.jpg"), 1);
  const auto report =
      nlohmann::json::parse(std::ifstream(dir_ + "/models/report.json"));
  EXPECT_EQ(report["images"][1]["name"], "\uFFFD.jpg");
  EXPECT_FALSE(StoredStatuses().empty());
  connection.Execute("UPDATE images SET name = '../a.jpg' WHERE image_id = 2");
  std::ofstream(dir_ + "/a.jpg") << "outside";
  EXPECT_EQ(Map({"--image_path", dir_ + "/scene"}), 1);
  EXPECT_EQ(Map(), 0);
}

TEST_F(GlobalDepthMapperTest, PaperPresetIsAppliedHoweverItIsSaid) {
  const auto is_paper = [this](const std::vector<std::string>& arguments) {
    EXPECT_EQ(Map(arguments), 0);
    const std::string project = FileContent(dir_ + "/models/project.ini");
    EXPECT_EQ(project.find("paper=1\n") != std::string::npos,
              project.find("skip_retriangulation=1\n") != std::string::npos);
    return project.find("skip_retriangulation=1\n") != std::string::npos;
  };
  for (const std::string value : {"1", "true", "yes", "on"}) {
    EXPECT_TRUE(is_paper({"--paper", value})) << value;
  }
  EXPECT_TRUE(is_paper({"--paper=on"}));
  EXPECT_FALSE(is_paper({"--paper", "no"}));
  const std::string project = dir_ + "/paper.ini";
  std::ofstream(project) << "paper=1\n";
  EXPECT_TRUE(is_paper({"--project_path", project}));
  EXPECT_FALSE(is_paper({"--project_path", project, "--paper", "0"}));
}

TEST(GlobalDepthMapper, PaperNeedsDepthOrFocalLengths) {
  const std::string dir = CreateTestDir();
  const std::string path = SynthesizeDatabase(
      dir, {"--num_images", "10", "--known_focal_length", "0"});
  const auto map = [&](const std::string& use_depth) {
    return RunForTest(&RunDepthGlobalMapper,
                      {"--database_path",
                       path,
                       "--output_path",
                       dir + "/models",
                       "--paper",
                       "1",
                       "--use_depth",
                       use_depth});
  };
  EXPECT_EQ(map("1").code, 0);
  const CommandResult result = map("0");
  EXPECT_EQ(result.code, 1);
  EXPECT_NE(result.err.find("--paper 1 has no estimator"), std::string::npos)
      << result.err;
}

TEST(GlobalDepthMapper, OneModelIsOneThoughItsPairsFallApart) {
  const std::string dir = CreateTestDir();
  const std::string path = SynthesizeDatabase(dir,
                                              {"--num_images",
                                               "16",
                                               "--num_points_per_image",
                                               "150",
                                               "--max_num_neighbors",
                                               "3",
                                               "--random_seed",
                                               "2"});
  const auto num_models = [&](const std::string& multiple_models) {
    EXPECT_EQ(RunForTest(&RunDepthGlobalMapper,
                         {"--database_path",
                          path,
                          "--output_path",
                          dir + "/models",
                          "--num_threads",
                          "1",
                          "--intrinsics_prior",
                          "calibrated",
                          // So strict that true pairs leave.
                          "--DepthGlobalMapper.max_rotation_error",
                          "0.3",
                          "--DepthGlobalMapper.skip_rotation_alternatives",
                          "1",
                          "--DepthGlobalMapper.multiple_models",
                          multiple_models})
                  .code,
              0);
    return nlohmann::json::parse(
               std::ifstream(dir + "/models/report.json"))["models"]
        .size();
  };
  EXPECT_GT(num_models("1"), 1);
  EXPECT_EQ(num_models("0"), 1);
  EXPECT_FALSE(fs::exists(dir + "/models/1"));
}

TEST_F(GlobalDepthMapperTest, PairsOfOtherOptionsAreVerifiedAgain) {
  const auto view_graph = [this] {
    return nlohmann::json::parse(
        std::ifstream(dir_ + "/models/report.json"))["view_graph"];
  };
  const std::vector<std::string> other = {"--random_seed", "3"};
  ASSERT_EQ(Map(other), 0);
  const auto expected = view_graph();
  ASSERT_EQ(RunForTest(&RunDepthGeometricVerifier,
                       {"--database_path",
                        path_,
                        "--num_threads",
                        "1",
                        "--PairVerification.min_num_inliers",
                        "1000"})
                .code,
            0);
  const CommandResult result = RunForTest(&RunDepthGlobalMapper,
                                          {"--database_path",
                                           path_,
                                           "--output_path",
                                           dir_ + "/models",
                                           "--num_threads",
                                           "1",
                                           "--random_seed",
                                           "3"});
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.err, testing::HasSubstr("they are verified now"));
  EXPECT_EQ(view_graph(), expected);
  // An earlier version had other fingerprints.
  ASSERT_EQ(RunForTest(&RunDepthGeometricVerifier,
                       {"--database_path",
                        path_,
                        "--num_threads",
                        "1",
                        "--random_seed",
                        "3"})
                .code,
            0);
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute(
          "UPDATE dgsfm_pair_geometries SET fingerprint = 1, status = 2 "
          "WHERE pair_id = 2147483649");
  ASSERT_EQ(Map(other), 0);
  EXPECT_EQ(view_graph(), expected);
}

TEST_F(GlobalDepthMapperTest, PairsOfFewKeypointsAreVerifiedByAllMatches) {
  const std::vector<std::string> few = {"--max_num_keypoints_per_image", "60"};
  const auto read_report = [this] {
    return nlohmann::json::parse(std::ifstream(dir_ + "/models/report.json"));
  };
  ASSERT_EQ(Map(few), 0);
  const auto report = read_report();
  EXPECT_EQ(report["models"][0]["images"], 12);
  // The two false pairs; what is left of others may be too little for the
  // model.
  EXPECT_EQ(report["pairs"]["rotation_outlier"], 2);
  for (const auto& entry : report["view_graph"]) {
    EXPECT_LT(entry["num_matches"], 60);
  }
  // Verified before, all that a pair is judged by is the same.
  ASSERT_EQ(RunForTest(&RunDepthGeometricVerifier,
                       {"--database_path", path_, "--num_threads", "1"})
                .code,
            0);
  ASSERT_EQ(Map(few), 0);
  EXPECT_EQ(read_report()["view_graph"], report["view_graph"]);
}

TEST_F(GlobalDepthMapperTest, LeavesTheDatabaseAloneOnDemand) {
  ASSERT_EQ(Map({"--write_pair_statuses", "0"}), 0);
  EXPECT_TRUE(StoredStatuses().empty());
  EXPECT_TRUE(DepthDatabase(path_, DepthDatabase::Mode::READ_ONLY)
                  .ReadPairFingerprints()
                  .empty());
}

TEST_F(GlobalDepthMapperTest, VerifiesPairsOnce) {
  const auto pair_stage = [this] {
    const auto report =
        nlohmann::json::parse(std::ifstream(dir_ + "/models/report.json"));
    for (const auto& stage : report["stages"]) {
      if (stage["stage"] == "pair_verification") return stage;
    }
    return nlohmann::json();
  };
  ASSERT_EQ(Map({}), 0);
  const size_t num_pairs = DepthDatabase(path_, DepthDatabase::Mode::READ_ONLY)
                               .ReadPairFingerprints()
                               .size();
  EXPECT_GT(num_pairs, 0);
  EXPECT_EQ(pair_stage()["kept"], 0);
  ASSERT_EQ(Map({}), 0);
  EXPECT_EQ(pair_stage()["kept"], num_pairs);
}

TEST_F(GlobalDepthMapperTest, ModelsComeOutOfADatabaseThatCannotBeWritten) {
  // Tables of a later version: refused for reading depth, so map without.
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE dgsfm_schema SET version = 99");
  EXPECT_EQ(Map({"--use_depth", "0"}), 0);
  EXPECT_TRUE(fs::exists(dir_ + "/models/0/images.bin"));
}

// Each image gets the map of the third one after it.
TEST(DepthGlobalMapperOnRealData, MapsOfOtherImagesCostNothing) {
  const auto data_set = SharedDataSet("fountain-P11");
  if (!data_set) GTEST_SKIP() << "no data set fountain-P11";
  const std::string dir = CreateTestDir();
  const std::string path = dir + "/database.db";
  fs::copy_file(*data_set + "/database.db", path);
  std::vector<fs::path> maps;
  for (const auto& entry : fs::directory_iterator(*data_set + "/depth")) {
    maps.push_back(entry.path());
  }
  std::sort(maps.begin(), maps.end());
  fs::create_directory(dir + "/depth");
  for (size_t i = 0; i < maps.size(); ++i) {
    fs::create_symlink(maps[(i + 3) % maps.size()],
                       dir + "/depth/" + maps[i].filename().string());
  }
  ASSERT_EQ(
      RunForTest(&RunDepthImporter,
                 {"--database_path", path, "--depth_path", dir + "/depth"})
          .code,
      0);
  ASSERT_EQ(RunForTest(&RunDepthGlobalMapper,
                       {"--database_path",
                        path,
                        "--output_path",
                        dir + "/models",
                        "--random_seed",
                        "0"})
                .code,
            0);
  const ModelEvaluation evaluation =
      EvaluateModel(dir + "/models", *data_set + "/gt", {1});
  // 92.0 without depth; seeds differ by 0.1.
  EXPECT_GT(evaluation.auc[0], 91.5);
}

// With 45 of 10,500 observations that belong to no point, the last adjustment
// was 3 points worse at one degree: they pulled at one camera.
TEST(DepthGlobalMapperOnRealData, LastAdjustmentIsWithoutOutliers) {
  const auto data_set = SharedDataSet("reichstag10");
  if (!data_set) GTEST_SKIP() << "no data set reichstag10";
  const std::string dir = CreateTestDir();
  const std::string path = dir + "/database.db";
  fs::copy_file(*data_set + "/database.db", path);
  ASSERT_EQ(RunForTest(&RunDepthGlobalMapper,
                       {"--database_path",
                        path,
                        "--output_path",
                        dir + "/models",
                        "--random_seed",
                        "0"})
                .code,
            0);
  const auto report =
      nlohmann::json::parse(std::ifstream(dir + "/models/report.json"));
  double last_num_filtered = -1;
  for (const auto& stage : report["stages"]) {
    if (stage["stage"] == "retriangulation" ||
        stage["stage"] == "final_adjustment") {
      last_num_filtered = stage["observations_filtered"];
    }
  }
  EXPECT_GE(last_num_filtered, 0);
  // Another round is made for a thousandth of the 10,500 observations.
  EXPECT_LT(last_num_filtered, 11);
}

}  // namespace
}  // namespace dgsfm
