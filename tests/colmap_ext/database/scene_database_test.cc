#include "colmap_ext/database/scene_database.h"

#include "tests/testing/colmap_database.h"
#include "tests/testing/test_dir.h"

#include <colmap/base/database.h>

#include <filesystem>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Pair;
using testing::ThrowsMessage;

using IndexPairs = std::vector<std::pair<int, int>>;

IndexPairs Indices(const colmap::FeatureMatches& matches) {
  IndexPairs indices;
  for (const colmap::FeatureMatch& match : matches) {
    indices.emplace_back(match.point2D_idx1, match.point2D_idx2);
  }
  return indices;
}

void ExpectSceneFails(const std::string& path,
                      const std::vector<std::string>& words) {
  try {
    ReadScene(path);
    ADD_FAILURE() << "read without an error";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr(path));
    for (const std::string& word : words) {
      EXPECT_THAT(error.what(), HasSubstr(word));
    }
  }
}

// Images a.jpg (id 1), b.jpg (2) and c.jpg (3, without key points), the first
// two matched.
class SceneDatabaseTest : public testing::TestWithParam<ColmapSchema> {
 protected:
  SceneDatabaseTest()
      : path_(CreateTestDir() + "/database.db"), writer_(path_, GetParam()) {
    writer_.AddCamera(2, 640, 480, {500, 320, 240, 0.125}, true);
    writer_.AddCamera(1, 800, 600, {700, 710, 400, 300});
    writer_.AddImage("a.jpg", 1, {{1, 2}, {3.5, 4.25}, {5, 6}});
    writer_.AddImage("b.jpg", 2, {{7, 8}, {9, 10}}, 4);
    writer_.AddImage("c.jpg", 2, std::vector<Eigen::Vector2d>());
    writer_.AddMatches(1, 2, {{0, 1}, {2, 0}});
  }

  void Execute(const std::string& sql) { writer_.Execute(sql); }

  const std::string path_;
  ColmapDatabaseWriter writer_;
};

INSTANTIATE_TEST_SUITE_P(AllSchemas,
                         SceneDatabaseTest,
                         testing::Values(ColmapSchema::V3_8,
                                         ColmapSchema::V3_12,
                                         ColmapSchema::V4_2),
                         [](const auto& test) {
                           return test.param == ColmapSchema::V3_8    ? "V3_8"
                                  : test.param == ColmapSchema::V3_12 ? "V3_12"
                                                                      : "V4_2";
                         });

TEST_P(SceneDatabaseTest, ReadsCamerasImagesAndMatches) {
  const Scene scene = ReadScene(path_);
  ASSERT_EQ(scene.cameras.size(), 2);
  const colmap::Camera& camera1 = scene.cameras.at(1);
  EXPECT_EQ(camera1.CameraId(), 1);
  EXPECT_EQ(camera1.ModelName(), "SIMPLE_RADIAL");
  EXPECT_EQ(camera1.Width(), 640);
  EXPECT_EQ(camera1.Height(), 480);
  EXPECT_EQ(camera1.Params(), (std::vector<double>{500, 320, 240, 0.125}));
  EXPECT_TRUE(camera1.HasPriorFocalLength());
  EXPECT_EQ(scene.cameras.at(2).ModelName(), "PINHOLE");
  EXPECT_FALSE(scene.cameras.at(2).HasPriorFocalLength());

  ASSERT_EQ(scene.images.size(), 3);
  const colmap::Image& image1 = scene.images.at(1);
  EXPECT_EQ(image1.ImageId(), 1);
  EXPECT_EQ(image1.Name(), "a.jpg");
  EXPECT_EQ(image1.CameraId(), 1);
  EXPECT_FALSE(image1.IsRegistered());
  ASSERT_EQ(image1.NumPoints2D(), 3);
  EXPECT_EQ(image1.Point2D(1).XY(), Eigen::Vector2d(3.5, 4.25));
  ASSERT_EQ(scene.images.at(2).NumPoints2D(), 2);
  EXPECT_EQ(scene.images.at(2).Point2D(1).XY(), Eigen::Vector2d(9, 10));
  EXPECT_EQ(scene.images.at(3).NumPoints2D(), 0);

  const IndexPairs expected = {{0, 1}, {2, 0}};
  ASSERT_EQ(scene.matches.size(), 1);
  EXPECT_EQ(Indices(scene.matches.at(PairIdOfImages(1, 2))), expected);
}

TEST_P(SceneDatabaseTest, LeavesOutMatchesWhereNotNeeded) {
  Execute("UPDATE matches SET data = x'00'");  // cannot be read
  const Scene scene = ReadScene(path_, SceneContent::FEATURES);
  EXPECT_EQ(scene.cameras.size(), 2);
  ASSERT_EQ(scene.images.size(), 3);
  EXPECT_EQ(scene.images.at(1).NumPoints2D(), 3);
  EXPECT_TRUE(scene.matches.empty());
}

TEST_P(SceneDatabaseTest, ReadsKeypointsOfSingleImages) {
  const Scene scene = ReadScene(path_, SceneContent::IMAGES);
  EXPECT_EQ(scene.cameras.size(), 2);
  ASSERT_EQ(scene.images.size(), 3);
  EXPECT_EQ(scene.images.at(1).NumPoints2D(), 0);
  const auto keypoints =
      ReadKeypoints(writer_.Connection(), scene.images.at(1));
  ASSERT_EQ(keypoints.size(), 3);
  EXPECT_EQ(keypoints[1], Eigen::Vector2d(3.5, 4.25));
  EXPECT_TRUE(ReadKeypoints(writer_.Connection(), scene.images.at(3)).empty());

  Execute("UPDATE keypoints SET rows = 4 WHERE image_id = 2");
  EXPECT_THAT([&] { ReadKeypoints(writer_.Connection(), scene.images.at(2)); },
              ThrowsMessage<std::runtime_error>(HasSubstr("image")));
}

TEST_P(SceneDatabaseTest, LeavesDatabaseAsItWas) {
  const auto version = [this] {
    SqliteStatement select(writer_.Connection(), "PRAGMA user_version");
    select.Step();
    return select.Int(0);
  };
  const int64_t version_before = version();
  const int num_changes = sqlite3_total_changes(writer_.Connection().Handle());
  ReadScene(path_);
  EXPECT_EQ(version(), version_before);
  EXPECT_EQ(sqlite3_total_changes(writer_.Connection().Handle()), num_changes);
}

TEST_P(SceneDatabaseTest, TakesVerifiedMatchesWhereRawOnesAreMissing) {
  Execute("DELETE FROM matches");
  const Scene scene = ReadScene(path_);
  ASSERT_EQ(scene.matches.size(), 1);
  EXPECT_EQ(scene.matches.begin()->second.size(), 2);
}

TEST_P(SceneDatabaseTest, TakesOnlySuccessfulConfigurationsAsVerified) {
  Execute("DELETE FROM matches");
  const std::set<int> verified = {2, 3, 4, 5, 6, 9};
  for (int config = 0; config < 10; ++config) {
    Execute("UPDATE two_view_geometries SET config = " +
            std::to_string(config));
    EXPECT_EQ(ReadScene(path_).matches.size(), verified.count(config))
        << "config " << config;
  }
}

TEST_P(SceneDatabaseTest, LeavesOutPairsWithoutMatches) {
  Execute("UPDATE matches SET rows = 0, data = NULL");
  Execute("UPDATE two_view_geometries SET rows = 0, data = NULL");
  const Scene scene = ReadScene(path_);
  EXPECT_TRUE(scene.matches.empty());
}

TEST_P(SceneDatabaseTest, RemovesDuplicateMatchesAndKeepsTheOrder) {
  Execute("DELETE FROM matches");
  writer_.AddMatches(1, 2, {{2, 0}, {0, 1}, {2, 0}, {0, 0}, {0, 1}}, false);
  EXPECT_EQ(Indices(ReadScene(path_).matches.begin()->second),
            (IndexPairs{{2, 0}, {0, 1}, {0, 0}}));
}

TEST_P(SceneDatabaseTest, TurnsMatchesToTheOrderOfThePairId) {
  Execute("DELETE FROM matches");
  writer_.AddMatches(2, 1, {{1, 0}}, false);
  const Scene scene = ReadScene(path_);
  EXPECT_EQ(Indices(scene.matches.at(PairIdOfImages(2, 1))),
            (IndexPairs{{0, 1}}));
}

TEST_P(SceneDatabaseTest, ReadsKeypointsOfTwoColumns) {
  const colmap::image_t image_id = writer_.AddImage("d.jpg", 1, {{11, 12}}, 2);
  EXPECT_EQ(ReadScene(path_).images.at(image_id).Point2D(0).XY(),
            Eigen::Vector2d(11, 12));
}

TEST_P(SceneDatabaseTest, NamesCameraAtFault) {
  Execute("UPDATE cameras SET model = 16 WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "model 16 (EUCM)"});
  Execute("UPDATE cameras SET model = 99 WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "model 99"});
  Execute(
      "UPDATE cameras SET model = -9223372036854775807 - 1 "
      "WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "model -9223372036854775808"});
  Execute("UPDATE cameras SET model = 2, params = x'00' WHERE camera_id = 2");
  ExpectSceneFails(path_, {"column params", "8 bytes"});
  Execute("UPDATE cameras SET params = zeroblob(24) WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "3 parameters", "SIMPLE_RADIAL"});
  Execute("UPDATE cameras SET params = zeroblob(32) WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "focal length 0"});
  // Eight bytes of ones are a NaN.
  Execute(
      "UPDATE cameras SET params = CAST(zeroblob(24) || x'FFFFFFFFFFFFFFFF' "
      "AS BLOB) WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "not finite"});
  // 1e200, and a focal length of 1e-310.
  Execute(
      "UPDATE cameras SET params = CAST(zeroblob(24) || x'5A62D7D718E77469' "
      "AS BLOB) WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "too large"});
  Execute(
      "UPDATE cameras SET params = "
      "x'2BE6708B68120000000000000000F03F000000000000F03F0000000000000000' "
      "WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "too small"});
  Execute("UPDATE cameras SET width = 2147483648 WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "2147483648 x 600"});
  Execute("UPDATE cameras SET width = 0 WHERE camera_id = 2");
  ExpectSceneFails(path_, {"camera 2", "0 x 600"});
  Execute("UPDATE cameras SET width = 'wide' WHERE camera_id = 2");
  ExpectSceneFails(path_, {"column width", "integer"});
}

TEST_P(SceneDatabaseTest, NamesImageAtFault) {
  Execute("PRAGMA foreign_keys = OFF");
  Execute("UPDATE images SET camera_id = 7 WHERE image_id = 2");
  ExpectSceneFails(path_, {"image b.jpg", "camera 7"});
  Execute("UPDATE images SET camera_id = 2 WHERE image_id = 2");
  Execute("UPDATE keypoints SET rows = 5 WHERE image_id = 2");
  ExpectSceneFails(path_, {"image b.jpg", "5 x 4", "8 stored"});
  Execute("UPDATE keypoints SET rows = -2, cols = -4 WHERE image_id = 2");
  ExpectSceneFails(path_, {"image b.jpg", "-4 columns"});
  Execute("UPDATE keypoints SET rows = 2, cols = 3 WHERE image_id = 2");
  ExpectSceneFails(path_, {"image b.jpg", "3 columns"});
  Execute(
      "UPDATE keypoints SET cols = 2, data = CAST(zeroblob(12) || x'FFFFFFFF' "
      "AS BLOB) WHERE image_id = 2");
  ExpectSceneFails(path_, {"image b.jpg", "key point 1", "not finite"});
  // A coordinate of 3e38.
  Execute(
      "UPDATE keypoints SET data = x'0000803F0000803FE6B1617F0000803F' "
      "WHERE image_id = 2");
  ExpectSceneFails(path_, {"image b.jpg", "key point 1", "too far away"});
}

TEST_P(SceneDatabaseTest, NamesImageWhoseNameBreaksFiles) {
  for (const char* name :
       {"''", "CAST(x'610062' AS TEXT)", "'a' || char(10)"}) {
    Execute(std::string("UPDATE images SET name = ") + name +
            " WHERE image_id = 2");
    ExpectSceneFails(path_, {"image 2", "is empty or has a NUL"});
  }
}

TEST_P(SceneDatabaseTest, NamesPairAtFault) {
  // Match (0, 1) with key points 3 and 2.
  Execute("UPDATE matches SET data = x'03000000010000000200000000000000'");
  ExpectSceneFails(path_,
                   {"pair a.jpg - b.jpg", "key point 3 of a.jpg, which has 3"});
  Execute("UPDATE matches SET data = x'00000000020000000200000000000000'");
  ExpectSceneFails(path_,
                   {"pair a.jpg - b.jpg", "key point 2 of b.jpg, which has 2"});
  Execute("UPDATE matches SET rows = 3");
  ExpectSceneFails(path_, {"pair a.jpg - b.jpg", "3 x 2", "4 stored"});
  Execute("UPDATE matches SET cols = 0");
  ExpectSceneFails(path_, {"pair a.jpg - b.jpg", "3 x 0"});
  Execute("UPDATE matches SET pair_id = 2147483647 * 1 + 9");
  ExpectSceneFails(path_, {"images 1 and 9", "no image 9"});
  Execute("UPDATE matches SET pair_id = 2147483647 * 2 + 1");
  ExpectSceneFails(path_, {"images 2 and 1", "ascending"});
  Execute("UPDATE matches SET pair_id = -5");
  ExpectSceneFails(path_, {"pair id -5", "out of range"});
}

// Copies of tables have no unique ids.
TEST_P(SceneDatabaseTest, NamesWhatIsThereTwice) {
  Execute("PRAGMA foreign_keys = OFF");
  const auto double_row = [this](const std::string& table) {
    Execute("CREATE TABLE copy AS SELECT * FROM " + table);
    Execute("DROP TABLE " + table);
    Execute("ALTER TABLE copy RENAME TO " + table);
    Execute("INSERT INTO " + table + " SELECT * FROM " + table +
            " WHERE rowid = 1");
  };
  double_row("keypoints");
  ExpectSceneFails(path_, {"image a.jpg", "two rows of key points"});
  Execute("DELETE FROM keypoints WHERE rowid = 3");
  double_row("images");
  Execute("UPDATE images SET name = 'd.jpg' WHERE rowid = 4");
  ExpectSceneFails(path_, {"two images have the id 1"});
  Execute("DELETE FROM images WHERE rowid = 4");
  double_row("cameras");
  ExpectSceneFails(path_, {"two cameras have the id 1"});
}

TEST_P(SceneDatabaseTest, CountsKeypointsOfImagesOnly) {
  Execute("PRAGMA foreign_keys = OFF");
  // Its lower 32 bits are the id of a.jpg, which has three key points.
  Execute(
      "INSERT INTO keypoints(image_id, rows, cols, data) "
      "VALUES (4294967297, 9, 2, x'')");
  Execute("UPDATE matches SET data = x'03000000010000000200000000000000'");
  ExpectSceneFails(path_,
                   {"pair a.jpg - b.jpg", "key point 3 of a.jpg, which has 3"});
}

TEST_P(SceneDatabaseTest, NamesMatchedImageWithoutKeypoints) {
  writer_.AddMatches(1, 3, {{0, 0}}, false);
  ExpectSceneFails(path_, {"image c.jpg has no key points"});
}

TEST_P(SceneDatabaseTest, RefusesDatabaseWithoutImages) {
  Execute("DELETE FROM images");
  ExpectSceneFails(path_, {"no images"});
}

TEST_P(SceneDatabaseTest, IgnoresDescriptors) {
  Execute("DROP TABLE descriptors");
  EXPECT_EQ(ReadScene(path_).images.size(), 3);
}

TEST(SceneDatabase, ReadsDatabaseOfColmapItself) {
  const std::string path = CreateTestDir() + "/database.db";
  {
    colmap::Database database(path);
    colmap::Camera camera;
    camera.InitializeWithName("OPENCV", 500, 640, 480);
    const colmap::camera_t camera_id = database.WriteCamera(camera);
    for (const char* name : {"x.png", "folder/y.png"}) {
      colmap::Image image;
      image.SetName(name);
      image.SetCameraId(camera_id);
      const colmap::image_t image_id = database.WriteImage(image);
      database.WriteKeypoints(image_id,
                              {colmap::FeatureKeypoint(0.5f, 0.5f),
                               colmap::FeatureKeypoint(1.5f, 2.5f)});
    }
    database.WriteMatches(2, 1, {{0, 1}});
    colmap::TwoViewGeometry geometry;
    geometry.config = colmap::TwoViewGeometry::UNCALIBRATED;
    geometry.inlier_matches = {{0, 1}};
    database.WriteTwoViewGeometry(2, 1, geometry);
    EXPECT_EQ(PairIdOfImages(2, 1), database.ImagePairToPairId(2, 1));
  }
  const Scene scene = ReadScene(path);
  EXPECT_EQ(scene.cameras.at(1).NumParams(), 8);
  EXPECT_EQ(scene.images.at(2).Name(), "folder/y.png");
  EXPECT_EQ(scene.images.at(2).Point2D(1).XY(), Eigen::Vector2d(1.5, 2.5));
  EXPECT_EQ(Indices(scene.matches.at(PairIdOfImages(1, 2))),
            (IndexPairs{{1, 0}}));
}

TEST(SceneDatabase, RefusesFilesThatAreNoColmapDatabase) {
  const std::string dir = CreateTestDir();
  ExpectSceneFails(dir + "/none.db", {"no such"});
  ExpectSceneFails(dir, {"folder"});
  SqliteConnection(dir + "/other.db", SqliteConnection::Mode::CREATE)
      .Execute("CREATE TABLE cameras(camera_id INTEGER)");
  ExpectSceneFails(dir + "/other.db", {"not a COLMAP database", "images"});
}

TEST(SceneDatabase, ReportsTruncatedDatabase) {
  const std::string path = CreateTestDir() + "/database.db";
  {
    ColmapDatabaseWriter writer(path, ColmapSchema::V4_2);
    writer.AddCamera(0, 640, 480, {500, 320, 240});
    writer.AddImage("a.jpg", 1, std::vector<Eigen::Vector2d>(5000, {1, 2}));
  }
  fs::resize_file(path, fs::file_size(path) / 2);
  ExpectSceneFails(path, {"truncated"});
}

TEST(SceneDatabase, ReadsSharedDataSet) {
  const auto data_set = SharedDataSet("fountain-P11");
  if (!data_set) GTEST_SKIP() << "../shared/data/fountain-P11 is absent";
  const std::string dir = CreateTestDir();
  const std::string path = dir + "/database.db";
  fs::copy_file(*data_set + "/database.db", path);
  const Scene scene = ReadScene(path);
  EXPECT_EQ(scene.cameras.size(), 11);
  EXPECT_EQ(scene.images.size(), 11);
  EXPECT_EQ(scene.matches.size(), 11 * 10 / 2);
  EXPECT_EQ(std::distance(fs::directory_iterator(dir), {}), 1);
}

TEST(PairId, RoundTripsInColmapsFormula) {
  EXPECT_EQ(PairIdOfImages(5, 3), 2147483647ull * 3 + 5);
  EXPECT_THAT(ImageIdsOfPair(PairIdOfImages(5, 3)), Pair(3, 5));
  EXPECT_THAT(ImageIdsOfPair(PairIdOfImages(2147483645, 2147483646)),
              Pair(2147483645, 2147483646));
  EXPECT_THROW(PairIdOfImages(1, 2147483647), std::invalid_argument);
  EXPECT_THROW(ImageIdsOfPair(std::numeric_limits<uint64_t>::max()),
               std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
