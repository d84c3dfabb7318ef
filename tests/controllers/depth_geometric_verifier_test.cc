#include "controllers/depth_geometric_verifier.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "tests/controllers/pair_rows.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/test_dir.h"

#include <cstdlib>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Fourteen images with noise and outliers, with unknown focal lengths.
class DepthGeometricVerifier : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    path_ = SynthesizeDatabase(dir_,
                               {"--num_images",
                                "14",
                                "--num_points_per_image",
                                "150",
                                "--outlier_match_ratio",
                                "0.3",
                                "--known_focal_length",
                                "0"});
    options_.database_path = path_;
    options_.verification.num_threads = 1;
  }

  std::string CopyDatabase(const std::string& name) const {
    const std::string copy = dir_ + "/" + name;
    fs::copy_file(path_, copy, fs::copy_options::overwrite_existing);
    return copy;
  }

  VerificationSummary Verify() const { return VerifyDatabasePairs(options_); }

  std::string dir_;
  std::string path_;
  DepthGeometricVerifierOptions options_;
};

size_t NumPairs(const PairTotals& totals) {
  size_t num_pairs = 0;
  for (const auto& [status, count] : totals.num_with_status) num_pairs += count;
  return num_pairs;
}

TEST_F(DepthGeometricVerifier, ThreadsDoNotChangeWhatIsStored) {
  const Scene scene = ReadScene(path_);
  const PairTotals totals = Verify().totals;
  EXPECT_EQ(NumPairs(totals), scene.matches.size());
  EXPECT_GT(totals.num_with_status.at(PairStatus::VALID), 30);
  const std::vector<std::string> rows = PairRows(path_);
  ASSERT_EQ(rows.size(), scene.matches.size());
  options_.verification.num_threads = 3;
  options_.restart = true;
  Verify();
  EXPECT_EQ(PairRows(path_), rows);
}

TEST_F(DepthGeometricVerifier, StoresWhatVerificationInMemoryGives) {
  Verify();
  const Scene scene = ReadScene(path_);
  const DepthDatabase database(path_, DepthDatabase::Mode::READ_ONLY);
  const auto stored = database.ReadPairGeometries();
  const PairGeometries pairs = VerifyPairs(
      scene, database.ReadAllKeypointDepths(), options_.verification);
  ASSERT_EQ(stored.size(), pairs.size());
  for (const auto& [pair_id, pair] : pairs) {
    EXPECT_EQ(stored.at(pair_id).status, pair.status);
    EXPECT_EQ(stored.at(pair_id).cam2_from_cam1.translation,
              pair.cam2_from_cam1.translation);
    EXPECT_EQ(stored.at(pair_id).log_scale_stddev, pair.log_scale_stddev);
  }
}

TEST_F(DepthGeometricVerifier, SecondRunDoesOnlyWhatIsNew) {
  EXPECT_EQ(Verify().num_kept, 0);
  const std::vector<std::string> rows = PairRows(path_);
  const VerificationSummary second = Verify();
  EXPECT_EQ(second.num_kept, rows.size());
  EXPECT_EQ(second.num_deleted, 0);
  EXPECT_EQ(PairRows(path_), rows);

  const Scene scene = ReadScene(path_);
  auto pair = scene.matches.begin();
  const std::string rematched = std::to_string((pair++)->first);
  const std::string gone = std::to_string((pair++)->first);
  const std::string added = std::to_string((pair++)->first);
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute(
          "UPDATE matches SET rows = rows - 1, "
          "data = substr(data, 1, 8 * (rows - 1)) WHERE pair_id = " +
          rematched + ";DELETE FROM matches WHERE pair_id = " + gone +
          ";DELETE FROM two_view_geometries WHERE pair_id = " + gone +
          ";DELETE FROM dgsfm_pair_geometries WHERE pair_id = " + added);
  const VerificationSummary third = Verify();
  EXPECT_EQ(NumPairs(third.totals), rows.size() - 1);
  EXPECT_EQ(third.num_kept, rows.size() - 3);
  EXPECT_EQ(third.num_deleted, 2);
  const std::vector<std::string> updated = PairRows(path_);
  options_.restart = true;
  EXPECT_EQ(Verify().num_kept, 0);
  EXPECT_EQ(PairRows(path_), updated);
}

TEST_F(DepthGeometricVerifier, OtherOptionsStartOver) {
  Verify();
  const std::vector<std::string> rows = PairRows(path_);
  options_.verification.random_seed = 1;
  EXPECT_EQ(Verify().num_deleted, rows.size());
  EXPECT_NE(PairRows(path_), rows);
  options_.verification.random_seed = 0;
  options_.verification.num_threads = 2;
  Verify();
  EXPECT_EQ(PairRows(path_), rows);
}

TEST_F(DepthGeometricVerifier, KilledRunsEndUpWithTheSameTables) {
  const std::string killed = CopyDatabase("killed.db");
  Verify();
  const std::vector<std::string> rows = PairRows(path_);
  size_t num_partial = 0;
  int code = 1;
  // From less than it takes to start, in steps that are small against all the
  // work, to as long as a busy machine may need.
  double seconds = 0.005;
  for (int run = 0; run < 200 && code != 0; ++run, seconds *= 1.05) {
    code = std::system(("timeout -s KILL " + std::to_string(seconds) +
                        " " DGSFM_COLMAP_MAIN
                        " depth_geometric_verifier --checkpoint_interval 0 "
                        "--num_threads 2 --database_path " +
                        killed + " >/dev/null 2>&1")
                           .c_str());
    const size_t num_rows = PairRows(killed).size();
    num_partial += num_rows > 0 && num_rows < rows.size();
  }
  EXPECT_EQ(code, 0);
  EXPECT_GT(num_partial, 0);
  EXPECT_EQ(PairRows(killed), rows);
}

TEST_F(DepthGeometricVerifier, MapperVerifiesTheRestOfABrokenRun) {
  Verify();
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("DELETE FROM dgsfm_pair_geometries WHERE pair_id = 2147483649");
  const CommandResult result =
      RunForTest(&RunDepthGlobalMapper,
                 {"--database_path", path_, "--output_path", dir_ + "/model"});
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.err, HasSubstr("] 1 pairs, e.g. "));
  EXPECT_THAT(result.err, HasSubstr("they are verified now"));
}

TEST_F(DepthGeometricVerifier, TablesOfVersion1AreBroughtUpToDate) {
  Verify();
  const std::vector<std::string> rows = PairRows(path_);
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute(
          "UPDATE dgsfm_schema SET version = 1;"
          "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN source_fingerprint;"
          "ALTER TABLE dgsfm_keypoint_depths "
          "DROP COLUMN keypoints_fingerprint;"
          "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN focal_length;"
          "ALTER TABLE dgsfm_pair_geometries DROP COLUMN fingerprint;");
  Verify();
  EXPECT_EQ(PairRows(path_), rows);
}

TEST_F(DepthGeometricVerifier, NamesInvalidOptionsAndDamagedMatches) {
  options_.checkpoint_interval_s = -1;
  EXPECT_THROW(VerifyDatabasePairs(options_), std::runtime_error);
  const CommandResult bad = RunForTest(
      &RunDepthGeometricVerifier,
      {"--database_path", path_, "--TwoViewDepth.max_epipolar_error", "0"});
  EXPECT_EQ(bad.code, 2);
  EXPECT_THAT(bad.err, HasSubstr("TwoViewDepth.max_epipolar_error must be"));
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE matches SET rows = 7 WHERE pair_id = 2147483649");
  const CommandResult result =
      RunForTest(&RunDepthGeometricVerifier, {"--database_path", path_});
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.err, HasSubstr("7 x 2 match values announced"));
}

}  // namespace
}  // namespace dgsfm
