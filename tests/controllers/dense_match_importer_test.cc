#include "controllers/dense_match_importer.h"

#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/formats/depth_file_formats.h"
#include "controllers/commands/commands.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/colmap_database.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/npz_file.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;

// Images x/a.jpg (1), x/b_c.jpg (2) and y/b_c.jpg (3) of 60 x 40 pixels.
class DenseMatchImporter : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    database_path_ = dir_ + "/database.db";
    ColmapDatabaseWriter writer(database_path_, ColmapSchema::V3_8);
    writer.AddCamera(0, 60, 40, {50, 30, 20});
    for (const char* name : {"x/a.jpg", "x/b_c.jpg", "y/b_c.jpg"}) {
      writer.AddImage(name, 1, std::vector<Eigen::Vector2d>());
    }
  }

  // One row per match: x1, y1, x2, y2.
  void WritePair(const std::string& group,
                 const std::vector<float>& values,
                 const std::string& array = "matches",
                 int num_cols = 4) const {
    AddToNpz(
        dir_ + "/matches.npz",
        group + "/" + array + ".npy",
        internal::FormatNpyFloat(
            {num_cols, static_cast<int>(values.size()) / num_cols, values}));
  }

  DenseMatchImportSummary Import(
      const DenseMatchImportOptions& options = {}) const {
    return ImportDenseMatches(
        database_path_, DenseMatchFile(dir_ + "/matches.npz"), options);
  }

  void ExpectError(const std::vector<std::string>& parts) const {
    ExpectErrorAndNoChange(
        database_path_, [this] { Import(); }, parts);
  }

  std::string dir_;
  std::string database_path_;
};

TEST_F(DenseMatchImporter, StoresPointsAsTheyAre) {
  WritePair("x/a.jpg<>x/b_c.jpg", {1.25f, 2, 3, 4, 5, 6, 7, 8.125f});
  // Names in the other order; the point of x/b_c.jpg is near that of before.
  WritePair("y/b_c.jpg<>x/b_c.jpg", {9, 10, 3.1f, 4, 11, 12, 13, 14});
  WritePair("z.jpg<>x/a.jpg", {1, 1, 1, 1});
  const DenseMatchImportSummary summary = Import();
  EXPECT_EQ(summary.num_pairs, 2);
  EXPECT_EQ(summary.num_matches, 4);
  EXPECT_EQ(summary.num_points, 8);
  EXPECT_EQ(summary.num_keypoints, 7);
  EXPECT_THAT(summary.groups_without_images,
              testing::ElementsAre("z.jpg<>x/a.jpg"));

  const Scene scene = ReadScene(database_path_);
  EXPECT_EQ(scene.images.at(1).Point2D(0).XY(), Eigen::Vector2d(1.25, 2));
  EXPECT_EQ(scene.images.at(2).NumPoints2D(), 3);
  EXPECT_EQ(scene.images.at(2).Point2D(0).XY(), Eigen::Vector2d(3, 4));
  const auto& matches = scene.matches.at(PairIdOfImages(2, 3));
  ASSERT_EQ(matches.size(), 2);
  EXPECT_EQ(matches[0].point2D_idx1, 0);
  EXPECT_EQ(matches[0].point2D_idx2, 0);
  EXPECT_EQ(scene.images.at(3).Point2D(0).XY(), Eigen::Vector2d(9, 10));
}

TEST_F(DenseMatchImporter, LeavesOutWhatIsOutsideOrUncertain) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  WritePair("a.jpg_x-b_c.jpg", {1, 1, 1, 1, 2, 2, 61,    2, nan, 1,
                                1, 1, 3, 3, 3, 3, 59.8f, 1, 1,   1});
  WritePair("a.jpg_x-b_c.jpg", {1, 1, 1, 0.25f, 1}, "certainty", 1);
  DenseMatchImportOptions options;
  options.min_confidence = 0.5;
  options.coordinate_offset_px = 0.5;
  const DenseMatchImportSummary summary = Import(options);
  EXPECT_EQ(summary.num_matches, 1);
  EXPECT_EQ(summary.num_matches_left_out, 4);
  EXPECT_EQ(ReadScene(database_path_).images.at(1).Point2D(0).XY(),
            Eigen::Vector2d(1.5, 1.5));
}

TEST_F(DenseMatchImporter, KeepsFeaturesUnlessToldOtherwise) {
  WritePair("x/a.jpg<>x/b_c.jpg", {1, 2, 3, 4});
  Import();
  ExpectError({database_path_, "has keypoints of 2 images", "--overwrite 1"});
  DenseMatchImportOptions options;
  options.overwrite = true;
  EXPECT_EQ(Import(options).num_matches, 1);
}

TEST_F(DenseMatchImporter, MergesBothDirectionsOfAPair) {
  WritePair("x/a.jpg<>x/b_c.jpg", {1, 2, 3, 4, 5, 6, 7, 8});
  // The first match again, within the merge radius, and another one.
  WritePair("x/b_c.jpg<>x/a.jpg", {3.1f, 4, 1, 2.1f, 11, 12, 13, 14});
  const DenseMatchImportSummary summary = Import();
  EXPECT_EQ(summary.num_pairs, 1);
  EXPECT_EQ(summary.num_matches, 3);
  EXPECT_EQ(summary.num_points, 8);
  EXPECT_EQ(summary.num_keypoints, 6);
  const Scene scene = ReadScene(database_path_);
  const auto& matches = scene.matches.at(PairIdOfImages(1, 2));
  ASSERT_EQ(matches.size(), 3);
  EXPECT_EQ(scene.images.at(1).Point2D(matches[2].point2D_idx1).XY(),
            Eigen::Vector2d(13, 14));
  EXPECT_EQ(scene.images.at(2).Point2D(matches[2].point2D_idx2).XY(),
            Eigen::Vector2d(11, 12));
}

TEST_F(DenseMatchImporter, ImportWithoutAnyMatchFails) {
  const std::string group = "x/a.jpg<>x/b_c.jpg";
  const auto write = [&](const std::vector<float>& values) {
    std::filesystem::remove(dir_ + "/matches.npz");
    WritePair(group, values);
  };
  write({});
  ExpectError({"matches.npz: no match is imported: the file has none", group});
  write({1, 2, 61, 4, 5, 6, 7, 41});
  ExpectError({"all 2 are outside of their images or below min_confidence"});
  write({0.1f, 0.2f, 0.3f, 0.4f, -0.5f, 0.5f, 1, 0.6f});
  ExpectError({"coordinates have to be pixels, not shares of the size"});
}

TEST_F(DenseMatchImporter, NamesWhatIsWrong) {
  WritePair("u.jpg<>v.jpg", {1, 2, 3, 4});
  ExpectError(
      {"matches.npz: no group is called after two images of the "
       "database, such as u.jpg<>v.jpg"});
  // There are two images b_c.jpg.
  WritePair("x/a.jpg<>b_c.jpg", {1, 2, 3, 4});
  ExpectError({"no group is called after two images"});
  WritePair("x/a.jpg<>x/b_c.jpg", {1, 2}, "matches0", 1);
  ExpectError({"pair x/a.jpg<>x/b_c.jpg: no arrays keypoints0"});
  WritePair("x/a.jpg<>x/b_c.jpg", {1, 2, 3, 4, 5, 6}, "matches", 3);
  ExpectError({"matches.npz, pair x/a.jpg<>x/b_c.jpg", "is not N x 4"});
  EXPECT_EQ(RunForTest(RunDenseMatchImporter,
                       {"--database_path",
                        database_path_,
                        "--match_path",
                        dir_ + "/matches.npz",
                        "--merge_radius",
                        "2"})
                .code,
            2);
  EXPECT_THAT(RunForTest(RunDenseMatchImporter,
                         {"--database_path",
                          database_path_,
                          "--match_path",
                          dir_ + "/matches.txt"})
                  .err,
              HasSubstr("neither a folder nor a file"));
}

}  // namespace
}  // namespace dgsfm
