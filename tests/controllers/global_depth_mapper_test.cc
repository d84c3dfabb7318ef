#include "colmap_ext/depth_database.h"
#include "colmap_ext/scene_database.h"
#include "controllers/commands.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>

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
}

TEST_F(GlobalDepthMapperTest, ModelsComeOutOfADatabaseThatCannotBeWritten) {
  // Tables of a later version: refused for reading depth, so map without.
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE dgsfm_schema SET version = 99");
  EXPECT_EQ(Map({"--use_depth", "0"}), 0);
  EXPECT_TRUE(fs::exists(dir_ + "/models/0/images.bin"));
}

}  // namespace
}  // namespace dgsfm
