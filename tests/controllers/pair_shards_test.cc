#include "colmap_ext/database/pair_shard_file.h"
#include "controllers/pair_geometry_merger.h"
#include "controllers/pair_shard_verifier.h"
#include "tests/controllers/pair_rows.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using PairSizes = DatabasePairVerifier::PairSizes;

TEST(PairsOfShard, CutsPairsIntoRangesOfAboutAsManyMatches) {
  PairSizes pairs;
  for (size_t i = 0; i < 100; ++i) pairs.push_back({i, (37 * i) % 500});
  double total = 0;
  for (const auto& pair : pairs) total += double(pair.num_matches);
  for (const int num_shards : {1, 2, 3, 7, 100}) {
    PairSizes joined;
    for (int i = 0; i < num_shards; ++i) {
      const PairSizes shard = PairsOfShard(pairs, i, num_shards);
      double num_matches = 0;
      for (const auto& pair : shard) num_matches += double(pair.num_matches);
      // A pair is never cut, and counts one more.
      EXPECT_NEAR(num_matches, total / num_shards, 502);
      joined.insert(joined.end(), shard.begin(), shard.end());
    }
    ASSERT_EQ(joined.size(), pairs.size());
    for (size_t i = 0; i < pairs.size(); ++i) {
      EXPECT_EQ(joined[i].pair_id, pairs[i].pair_id);
    }
  }
  EXPECT_TRUE(PairsOfShard({}, 0, 2).empty());
}

TEST(ShardOptions, ComeBackFromTheirText) {
  DepthGeometricVerifierOptions options;
  options.use_depth = false;
  options.intrinsics_prior = "exif";
  options.verification.two_view.max_epipolar_error_px = 0.1;
  options.verification.random_seed = 3;
  options.verification.num_threads = 5;
  const std::string text = ShardOptionsText(options);
  const DepthGeometricVerifierOptions read = OptionsOfShard(text);
  EXPECT_EQ(ShardOptionsText(read), text);
  EXPECT_FALSE(read.use_depth);
  EXPECT_EQ(read.intrinsics_prior, "exif");
  EXPECT_EQ(read.verification.two_view.max_epipolar_error_px, 0.1);
  EXPECT_EQ(read.verification.num_threads, -1);
  EXPECT_THROW(OptionsOfShard("no_option=1"), std::runtime_error);
  EXPECT_THROW(OptionsOfShard("["), std::runtime_error);
}

// Twenty images with noise and outliers, with unknown focal lengths.
class PairShards : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    path_ = Synthesize(dir_, "0");
    options_.database_path = path_;
    options_.verification.num_threads = 2;
  }

  static std::string Synthesize(const std::string& dir,
                                const std::string& seed) {
    return SynthesizeDatabase(dir,
                              {"--num_images",
                               "20",
                               "--num_points_per_image",
                               "120",
                               "--outlier_match_ratio",
                               "0.3",
                               "--known_focal_length",
                               "0",
                               "--random_seed",
                               seed});
  }

  std::string CopyDatabase(const std::string& name) const {
    const std::string copy = dir_ + "/" + name;
    fs::copy_file(path_, copy, fs::copy_options::overwrite_existing);
    return copy;
  }

  std::string ShardPath(int index) const {
    return dir_ + "/shards/" + std::to_string(index) + ".db";
  }

  VerificationSummary VerifyShard(int index, int num_shards) const {
    fs::create_directories(dir_ + "/shards");
    DepthGeometricVerifierOptions options = options_;
    options.shard_index = index;
    options.num_shards = num_shards;
    options.output_path = ShardPath(index);
    return VerifyPairShard(options);
  }

  void VerifyShards(int num_shards) const {
    fs::remove_all(dir_ + "/shards");
    for (int i = 0; i < num_shards; ++i) VerifyShard(i, num_shards);
  }

  VerificationSummary Merge(const std::string& database_path) const {
    PairGeometryMergerOptions options;
    options.database_path = database_path;
    options.shard_paths = dir_ + "/shards";
    return MergePairShards(options);
  }

  std::vector<std::string> RowsOfOneRun() const {
    DepthGeometricVerifierOptions options = options_;
    options.database_path = CopyDatabase("single.db");
    VerifyDatabasePairs(options);
    return PairRows(options.database_path);
  }

  std::string dir_;
  std::string path_;
  DepthGeometricVerifierOptions options_;
};

TEST_F(PairShards, GiveTheTableOfOneRun) {
  const std::vector<std::string> rows = RowsOfOneRun();
  ASSERT_GT(rows.size(), 30);
  const std::string bytes = FileContent(path_);
  for (const int num_shards : {1, 2, 3, 7}) {
    VerifyShards(num_shards);
    EXPECT_EQ(FileContent(path_), bytes);
    EXPECT_FALSE(fs::exists(path_ + "-wal"));
    const std::string merged = CopyDatabase("merged.db");
    EXPECT_EQ(Merge(merged).NumPairs(), rows.size());
    EXPECT_EQ(PairRows(merged), rows);
    Merge(merged);
    EXPECT_EQ(PairRows(merged), rows);
    // A run on the merged database has nothing left to do.
    DepthGeometricVerifierOptions options = options_;
    options.database_path = merged;
    EXPECT_EQ(VerifyDatabasePairs(options).num_kept, rows.size());
  }
}

TEST_F(PairShards, ReplaceWhatOtherOptionsStored) {
  const std::vector<std::string> rows = RowsOfOneRun();
  VerifyShards(2);
  DepthGeometricVerifierOptions other = options_;
  other.verification.random_seed = 1;
  VerifyDatabasePairs(other);
  EXPECT_NE(PairRows(path_), rows);
  Merge(path_);
  EXPECT_EQ(PairRows(path_), rows);
}

TEST_F(PairShards, HaveTheSameBytesEachTimeAndAreKept) {
  EXPECT_EQ(VerifyShard(1, 3).num_kept, 0);
  const std::string bytes = FileContent(ShardPath(1));
  const auto time = fs::last_write_time(ShardPath(1));
  EXPECT_GT(VerifyShard(1, 3).num_kept, 5);
  EXPECT_EQ(fs::last_write_time(ShardPath(1)), time);
  options_.restart = true;
  options_.verification.num_threads = 1;
  EXPECT_EQ(VerifyShard(1, 3).num_kept, 0);
  EXPECT_EQ(FileContent(ShardPath(1)), bytes);
  options_.restart = false;
  options_.verification.random_seed = 1;
  EXPECT_EQ(VerifyShard(1, 3).num_kept, 0);
  EXPECT_NE(FileContent(ShardPath(1)), bytes);
  // Nothing is left beside the file.
  EXPECT_EQ(std::distance(fs::directory_iterator(dir_ + "/shards"), {}), 1);
}

TEST_F(PairShards, WithMapsOfUnknownScaleAndShiftGiveTheTableOfOneRun) {
  // The values of the maps serve as disparity.
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE dgsfm_keypoint_depths SET unit = 3");
  const std::vector<std::string> rows = RowsOfOneRun();
  VerifyShards(3);
  Merge(path_);
  EXPECT_EQ(PairRows(path_), rows);
}

TEST_F(PairShards, NamesMissingDoubledAndDifferentShards) {
  VerifyShards(4);
  const std::string bytes = FileContent(path_);
  fs::remove(ShardPath(1));
  fs::remove(ShardPath(3));
  ExpectError([&] { Merge(path_); },
              "of 4 shards these are missing: 1, 3; verify");
  fs::remove(ShardPath(2));
  ExpectError([&] { Merge(path_); },
              "of 4 shards these are missing: 1-3; verify");
  VerifyShards(4);
  fs::copy(ShardPath(1), dir_ + "/shards/one.db");
  ExpectError([&] { Merge(path_); }, "one.db: is shard 1, as is ");
  fs::remove(dir_ + "/shards/one.db");
  options_.verification.min_num_inliers = 16;
  VerifyShard(2, 4);
  ExpectError([&] { Merge(path_); },
              "2.db: was verified with other options than ");
  VerifyShard(2, 5);
  ExpectError([&] { Merge(path_); }, "2.db: is one of 5 shards, ");
  EXPECT_EQ(FileContent(path_), bytes);
}

TEST_F(PairShards, RefusesShardsOfOtherData) {
  VerifyShards(3);
  const std::string other_dir = dir_ + "/other";
  fs::create_directories(other_dir);
  const std::string other = Synthesize(other_dir, "1");
  ExpectError([&] { Merge(other); }, "0.db: is of another database than ");
  // A pair of the last shard gets one match less, which is too few to move a
  // border.
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute(
          "UPDATE matches SET rows = rows - 1, "
          "data = substr(data, 1, 8 * (rows - 1)) WHERE pair_id = "
          "(SELECT max(pair_id) FROM matches WHERE rows > 1)");
  ExpectError([&] { Merge(path_); }, "2.db: is of another database than ");
  VerifyShard(2, 3);
  EXPECT_GT(Merge(path_).NumPairs(), 30);
}

TEST_F(PairShards, RefusesDamagedFiles) {
  VerifyShards(2);
  const std::string bytes = FileContent(ShardPath(0));
  const auto merge_with = [&](const std::string& damaged) {
    std::ofstream(ShardPath(0), std::ios::binary) << damaged;
    return RunForTest(
        &RunPairGeometryMerger,
        {"--database_path", path_, "--shard_paths", dir_ + "/shards"});
  };
  EXPECT_EQ(merge_with(bytes.substr(0, bytes.size() / 2)).code, 1);
  EXPECT_EQ(merge_with("").code, 1);
  // A bit of an inlier, in the middle of the largest run of data.
  std::string flipped = bytes;
  flipped[3 * bytes.size() / 4] ^= 1;
  const CommandResult result = merge_with(flipped);
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.err, HasSubstr("0.db: "));
  EXPECT_TRUE(PairRows(path_).empty());
  const CommandResult good = merge_with(bytes);
  EXPECT_EQ(good.code, 0);
  EXPECT_THAT(good.out, HasSubstr("merged 77 pairs, "));
}

TEST_F(PairShards, LeavesFilesAloneThatAreNoShards) {
  const std::string bytes = FileContent(path_);
  const CommandResult result = RunForTest(
      &RunDepthGeometricVerifier,
      {"--database_path", path_, "--output_path", path_, "--num_shards", "2"});
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.err, HasSubstr("is no result of"));
  EXPECT_EQ(FileContent(path_), bytes);
  EXPECT_EQ(RunForTest(&RunDepthGeometricVerifier,
                       {"--database_path", path_, "--num_shards", "2"})
                .code,
            2);
  EXPECT_EQ(RunForTest(&RunDepthGeometricVerifier,
                       {"--database_path",
                        path_,
                        "--output_path",
                        dir_ + "/no/shard.db",
                        "--num_shards",
                        "2"})
                .code,
            1);
}

TEST_F(PairShards, RefusesADatabaseThatIsBeingWritten) {
  const SqliteConnection writer(path_, SqliteConnection::Mode::READ_WRITE);
  writer.Execute("PRAGMA journal_mode = WAL; CREATE TABLE more (a INTEGER)");
  ExpectError([&] { VerifyShard(0, 2); }, "is being written");
}

}  // namespace
}  // namespace dgsfm
