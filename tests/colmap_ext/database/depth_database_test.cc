#include "colmap_ext/database/depth_database.h"

#include "colmap_ext/database/scene_database.h"
#include "tests/testing/colmap_database.h"
#include "tests/testing/test_dir.h"

#include <colmap/base/database.h>

#include <filesystem>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using Mode = DepthDatabase::Mode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;

// Depths that half-precision floats hold exactly.
DepthMap TestDepthMap() {
  return {3, 2, DepthUnit::METRIC, {0, 0.5f, 1, 2.25f, 0, 100}};
}

PairGeometry TestPairGeometry() {
  PairGeometry geometry;
  geometry.status = PairStatus::DEPTH_INCONSISTENT;
  geometry.cam2_from_cam1 =
      Rigid3d(Eigen::Quaterniond(0.1, 0.2, 0.3, 0.4).normalized(),
              Eigen::Vector3d(0.1, -2, 1e-300));
  geometry.has_scale = true;
  geometry.scale_1_from_2 = 1.0 / 3;
  geometry.focal_length1_px = 500.1;
  geometry.focal_length2_px = 700.2;
  geometry.estimated_focal2 = true;
  geometry.Set(PairDegeneracy::PLANAR);
  geometry.Set(PairDegeneracy::WEAK_FOCAL1);
  geometry.log_scale_stddev = 0.1;
  geometry.fingerprint = 0xFEDCBA9876543210;
  geometry.num_matches = 7;
  geometry.inlier_matches = {{2, 0}, {0, 1}};
  geometry.depth_verified = {0, 1};
  return geometry;
}

void ExpectEqual(const PairGeometry& a, const PairGeometry& b) {
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.cam2_from_cam1.rotation.coeffs(),
            b.cam2_from_cam1.rotation.coeffs());
  EXPECT_EQ(a.cam2_from_cam1.translation, b.cam2_from_cam1.translation);
  EXPECT_EQ(a.has_scale, b.has_scale);
  EXPECT_EQ(a.scale_1_from_2, b.scale_1_from_2);
  EXPECT_EQ(a.focal_length1_px, b.focal_length1_px);
  EXPECT_EQ(a.focal_length2_px, b.focal_length2_px);
  EXPECT_EQ(a.estimated_focal1, b.estimated_focal1);
  EXPECT_EQ(a.estimated_focal2, b.estimated_focal2);
  EXPECT_EQ(a.degeneracies, b.degeneracies);
  EXPECT_EQ(a.log_scale_stddev, b.log_scale_stddev);
  EXPECT_EQ(a.fingerprint, b.fingerprint);
  EXPECT_EQ(a.num_matches, b.num_matches);
  ASSERT_EQ(a.inlier_matches.size(), b.inlier_matches.size());
  for (size_t i = 0; i < a.inlier_matches.size(); ++i) {
    EXPECT_EQ(a.inlier_matches[i].point2D_idx1,
              b.inlier_matches[i].point2D_idx1);
    EXPECT_EQ(a.inlier_matches[i].point2D_idx2,
              b.inlier_matches[i].point2D_idx2);
  }
  EXPECT_EQ(a.depth_verified, b.depth_verified);
}

// Images a.jpg (id 1, three key points), b.jpg (2, two) and c.jpg (3, none).
class DepthDatabaseTest : public testing::Test {
 protected:
  DepthDatabaseTest() : path_(CreateTestDir() + "/database.db") {
    ColmapDatabaseWriter writer(path_, ColmapSchema::V4_2);
    writer.AddCamera(0, 640, 480, {500, 320, 240});
    writer.AddImage("a.jpg", 1, {{1, 2}, {3, 4}, {5, 6}});
    writer.AddImage("b.jpg", 1, {{7, 8}, {9, 10}});
    writer.AddImage("c.jpg", 1, std::vector<Eigen::Vector2d>());
    writer.AddMatches(1, 2, {{0, 1}, {2, 0}});
  }

  void Execute(const std::string& sql) const {
    SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE).Execute(sql);
  }

  void WriteAll() const {
    DepthDatabase database(path_, Mode::READ_WRITE);
    database.WriteDepthMap(
        1, TestDepthMap(), {DepthUnit::METRIC, {1.5f, 0, 0.1f}});
    database.WriteDepthMap(2, TestDepthMap(), {DepthUnit::METRIC, {1, 2}});
    database.WritePairGeometries({{PairIdOfImages(1, 2), TestPairGeometry()}});
  }

  template <typename Read>
  void ExpectReadFails(const Read& read,
                       const std::vector<std::string>& words) const {
    const DepthDatabase database(path_, Mode::READ_ONLY);
    try {
      read(database);
      ADD_FAILURE() << "read without an error";
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(path_));
      for (const std::string& word : words) {
        EXPECT_THAT(error.what(), HasSubstr(word));
      }
    }
  }

  const std::string path_;
};

TEST_F(DepthDatabaseTest, ReturnsDepthAsWritten) {
  DepthMap depth_map = TestDepthMap();
  {
    DepthDatabase database(path_, Mode::READ_WRITE);
    database.WriteDepthMap(
        1, depth_map, {DepthUnit::METRIC, {1.5f, 0, 0.1f}, 512.3});
    depth_map.unit = DepthUnit::RELATIVE;
    database.WriteDepthMap(3, depth_map, {DepthUnit::RELATIVE, {}});
  }
  const DepthDatabase database(path_, Mode::READ_ONLY);
  EXPECT_TRUE(database.HasDepthMap(1));
  EXPECT_FALSE(database.HasDepthMap(2));
  EXPECT_EQ(database.ReadDepthMap(1).width, 3);
  EXPECT_EQ(database.ReadDepthMap(1).height, 2);
  EXPECT_EQ(database.ReadDepthMap(1).unit, DepthUnit::METRIC);
  EXPECT_EQ(database.ReadDepthMap(1).values, TestDepthMap().values);
  EXPECT_EQ(database.ReadDepthMap(3).unit, DepthUnit::RELATIVE);
  const auto depths = database.ReadAllKeypointDepths();
  ASSERT_EQ(depths.size(), 2);
  EXPECT_EQ(depths.at(1).unit, DepthUnit::METRIC);
  EXPECT_EQ(depths.at(1).depths, (std::vector<float>{1.5f, 0, 0.1f}));
  EXPECT_EQ(depths.at(1).focal_length_px, 512.3);
  EXPECT_EQ(depths.at(3).unit, DepthUnit::RELATIVE);
  EXPECT_EQ(depths.at(3).focal_length_px, 0);
  EXPECT_TRUE(depths.at(3).depths.empty());
  EXPECT_EQ(database.ReadKeypointDepths(1)->depths, depths.at(1).depths);
  EXPECT_FALSE(database.ReadKeypointDepths(2));
  EXPECT_EQ(database.ReadAllKeypointDepths({{1, {0, 2}}}).at(1).depths,
            (std::vector<float>{1.5f, 0.1f}));
}

TEST_F(DepthDatabaseTest, ReplacesDepthOfAnImage) {
  WriteAll();
  DepthDatabase database(path_, Mode::READ_WRITE);
  database.WriteDepthMap(
      1, {1, 1, DepthUnit::RELATIVE, {4}}, {DepthUnit::RELATIVE, {4, 4, 4}});
  EXPECT_EQ(database.ReadDepthMap(1).values, std::vector<float>{4});
  EXPECT_EQ(database.ReadAllKeypointDepths().at(1).depths,
            (std::vector<float>{4, 4, 4}));
  EXPECT_EQ(database.ReadDepthMap(2).values, TestDepthMap().values);
}

TEST_F(DepthDatabaseTest, ReturnsPairGeometriesAsWritten) {
  PairGeometry failed;
  failed.num_matches = 3;
  {
    DepthDatabase database(path_, Mode::READ_WRITE);
    database.WritePairGeometries({{PairIdOfImages(1, 2), failed}});
    database.WritePairGeometries({{PairIdOfImages(1, 2), TestPairGeometry()},
                                  {PairIdOfImages(1, 3), failed}});
  }
  DepthDatabase database(path_, Mode::READ_WRITE);
  const auto geometries = database.ReadPairGeometries();
  ASSERT_EQ(geometries.size(), 2);
  ExpectEqual(geometries.at(PairIdOfImages(1, 2)), TestPairGeometry());
  ExpectEqual(geometries.at(PairIdOfImages(1, 3)), failed);
  EXPECT_THAT(database.ReadPairFingerprints(),
              ElementsAre(std::make_pair(PairIdOfImages(1, 2),
                                         TestPairGeometry().fingerprint),
                          std::make_pair(PairIdOfImages(1, 3), uint64_t(0))));
  database.DeletePairGeometries({PairIdOfImages(1, 2), PairIdOfImages(2, 3)});
  EXPECT_EQ(database.ReadPairFingerprints().size(), 1);
  database.DeleteAllPairGeometries();
  EXPECT_TRUE(database.ReadPairGeometries().empty());
}

TEST_F(DepthDatabaseTest, ReplacesPairStatuses) {
  DepthDatabase database(path_, Mode::READ_WRITE);
  EXPECT_TRUE(database.ReadPairStatuses().empty());
  database.WritePairStatuses(
      {{PairIdOfImages(1, 2), PairStatus::VALID},
       {PairIdOfImages(1, 3), PairStatus::ROTATION_OUTLIER}});
  const std::map<colmap::image_pair_t, PairStatus> statuses = {
      {PairIdOfImages(2, 3), PairStatus::MODEL_OUTLIER}};
  database.WritePairStatuses(statuses);
  EXPECT_EQ(database.ReadPairStatuses(), statuses);
}

TEST_F(DepthDatabaseTest, CountsPairsOfEachKind) {
  DepthDatabase database(path_, Mode::READ_WRITE);
  EXPECT_TRUE(database.ReadPairTotals().num_with_status.empty());
  PairGeometry valid = TestPairGeometry();
  valid.status = PairStatus::VALID;
  database.WritePairGeometries({{PairIdOfImages(1, 2), TestPairGeometry()},
                                {PairIdOfImages(1, 3), valid},
                                {PairIdOfImages(2, 3), valid}});
  const PairTotals totals = database.ReadPairTotals();
  EXPECT_THAT(totals.num_with_status,
              ElementsAre(std::make_pair(PairStatus::VALID, 2),
                          std::make_pair(PairStatus::DEPTH_INCONSISTENT, 1)));
  EXPECT_THAT(totals.num_valid_with_degeneracy,
              ElementsAre(std::make_pair(PairDegeneracy::PLANAR, 2),
                          std::make_pair(PairDegeneracy::WEAK_FOCAL1, 2)));
}

TEST_F(DepthDatabaseTest, OpeningAloneChangesNothing) {
  const std::string content = FileContent(path_);
  for (const Mode mode : {Mode::READ_ONLY, Mode::READ_WRITE}) {
    const DepthDatabase database(path_, mode);
    EXPECT_FALSE(database.HasDepthMap(1));
    EXPECT_TRUE(database.ReadAllKeypointDepths().empty());
    EXPECT_TRUE(database.ReadPairGeometries().empty());
  }
  EXPECT_EQ(FileContent(path_), content);
  ExpectReadFails([](const auto& database) { database.ReadDepthMap(2); },
                  {"image b.jpg", "no depth map"});
}

TEST_F(DepthDatabaseTest, UndoesTransactionThatIsNotCommitted) {
  const std::string content = FileContent(path_);
  {
    DepthDatabase database(path_, Mode::READ_WRITE);
    database.BeginTransaction();
    database.WriteDepthMap(2, TestDepthMap(), {DepthUnit::METRIC, {1, 2}});
    EXPECT_TRUE(database.HasDepthMap(2));
    EXPECT_THROW(database.BeginTransaction(), std::invalid_argument);
  }
  EXPECT_EQ(FileContent(path_), content);
  DepthDatabase database(path_, Mode::READ_WRITE);
  EXPECT_THROW(database.CommitTransaction(), std::invalid_argument);
  database.BeginTransaction();
  database.WriteDepthMap(2, TestDepthMap(), {DepthUnit::METRIC, {1, 2}});
  database.CommitTransaction();
  EXPECT_TRUE(DepthDatabase(path_, Mode::READ_ONLY).HasDepthMap(2));
}

TEST_F(DepthDatabaseTest, FailedWriteLeavesDatabaseAsItWas) {
  const std::string content = FileContent(path_);
  {
    DepthDatabase database(path_, Mode::READ_WRITE);
    EXPECT_THAT(
        [&] {
          database.WriteDepthMap(9, TestDepthMap(), {DepthUnit::METRIC, {}});
        },
        ThrowsMessage<std::runtime_error>(HasSubstr("no image with id 9")));
    EXPECT_THROW(database.WriteDepthMap(
                     2, TestDepthMap(), {DepthUnit::METRIC, {1, 2, 3}}),
                 std::invalid_argument);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THROW(database.WriteDepthMap(
                     2, TestDepthMap(), {DepthUnit::METRIC, {1, nan}}),
                 std::invalid_argument);
    PairGeometry geometry = TestPairGeometry();
    geometry.scale_1_from_2 = nan;
    EXPECT_THROW(
        database.WritePairGeometries({{PairIdOfImages(1, 2), geometry}}),
        std::invalid_argument);
    geometry = TestPairGeometry();
    geometry.depth_verified.pop_back();
    EXPECT_THROW(
        database.WritePairGeometries({{PairIdOfImages(1, 2), geometry}}),
        std::invalid_argument);
  }
  EXPECT_EQ(FileContent(path_), content);
  DepthDatabase reader(path_, Mode::READ_ONLY);
  EXPECT_THROW(reader.DeleteAllPairGeometries(), std::invalid_argument);
}

TEST_F(DepthDatabaseTest, RefusesAnotherVersionOfTheTables) {
  WriteAll();
  Execute("UPDATE dgsfm_schema SET version = 5");
  for (const Mode mode : {Mode::READ_ONLY, Mode::READ_WRITE}) {
    EXPECT_THAT([&] { DepthDatabase(path_, mode); },
                ThrowsMessage<std::runtime_error>(
                    AllOf(HasSubstr(path_), HasSubstr("version 5"))));
  }
}

TEST_F(DepthDatabaseTest, BringsTablesOfVersion1UpToDate) {
  WriteAll();
  // The columns that versions 3 and 2 added.
  Execute(
      "UPDATE dgsfm_schema SET version = 1;"
      "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN source_fingerprint;"
      "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN keypoints_fingerprint;"
      "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN focal_length;"
      "ALTER TABLE dgsfm_pair_geometries DROP COLUMN degeneracies;"
      "ALTER TABLE dgsfm_pair_geometries DROP COLUMN log_scale_stddev;"
      "ALTER TABLE dgsfm_pair_geometries DROP COLUMN fingerprint;");
  EXPECT_THAT([&] { DepthDatabase(path_, Mode::READ_ONLY); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(path_),
                        HasSubstr("version 1"),
                        HasSubstr("run depth_geometric_verifier"))));
  {
    DepthDatabase database(path_, Mode::READ_WRITE);
    database.WritePairGeometries({{PairIdOfImages(1, 2), TestPairGeometry()}});
  }
  const DepthDatabase database(path_, Mode::READ_ONLY);
  EXPECT_EQ(database.ReadDepthMap(1).values, TestDepthMap().values);
  const auto depths = database.ReadAllKeypointDepths();
  EXPECT_EQ(depths.at(1).depths, (std::vector<float>{1.5f, 0, 0.1f}));
  EXPECT_EQ(depths.at(1).focal_length_px, 0);
  ExpectEqual(database.ReadPairGeometries().at(PairIdOfImages(1, 2)),
              TestPairGeometry());
}

TEST_F(DepthDatabaseTest, DropsPairGeometriesOfVersion3) {
  WriteAll();
  Execute(
      "UPDATE dgsfm_schema SET version = 3;"
      "ALTER TABLE dgsfm_pair_geometries DROP COLUMN log_scale_stddev;"
      "ALTER TABLE dgsfm_pair_geometries "
      "ADD COLUMN covariance BLOB NOT NULL DEFAULT x'';");
  {
    const DepthDatabase database(path_, Mode::READ_ONLY);
    EXPECT_TRUE(database.ReadPairGeometries().empty());
    EXPECT_TRUE(database.ReadPairFingerprints().empty());
    EXPECT_TRUE(database.ReadPairTotals().num_with_status.empty());
    EXPECT_EQ(database.ReadAllKeypointDepths().at(1).depths,
              (std::vector<float>{1.5f, 0, 0.1f}));
  }
  DepthDatabase database(path_, Mode::READ_WRITE);
  EXPECT_TRUE(database.ReadPairGeometries().empty());
  EXPECT_EQ(database.ReadAllKeypointDepths().at(1).depths,
            (std::vector<float>{1.5f, 0, 0.1f}));
  database.WritePairGeometries({{PairIdOfImages(1, 2), TestPairGeometry()}});
  ExpectEqual(database.ReadPairGeometries().at(PairIdOfImages(1, 2)),
              TestPairGeometry());
}

TEST_F(DepthDatabaseTest, KeepsDepthsOfVersion2) {
  WriteAll();
  Execute(
      "UPDATE dgsfm_schema SET version = 2;"
      "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN source_fingerprint;"
      "ALTER TABLE dgsfm_keypoint_depths DROP COLUMN keypoints_fingerprint;");
  EXPECT_THROW(DepthDatabase(path_, Mode::READ_ONLY), std::runtime_error);
  const DepthDatabase database(path_, Mode::READ_WRITE);
  EXPECT_TRUE(database.ReadPairGeometries().empty());
  EXPECT_EQ(database.ReadAllKeypointDepths().at(1).depths,
            (std::vector<float>{1.5f, 0, 0.1f}));
  // Nothing is known of where they came from.
  EXPECT_TRUE(database.ReadSourceFingerprints().empty());
}

TEST_F(DepthDatabaseTest, KeepsKeypointDepthsWithoutMap) {
  WriteAll();
  {
    DepthDatabase database(path_, Mode::READ_WRITE);
    database.WriteKeypointDepths(2, {DepthUnit::METRIC, {3, 4}, 0, 77});
  }
  const DepthDatabase database(path_, Mode::READ_ONLY);
  EXPECT_TRUE(database.HasDepthMap(1));
  EXPECT_FALSE(database.HasDepthMap(2));
  EXPECT_EQ(database.ReadAllKeypointDepths().at(2).depths,
            (std::vector<float>{3, 4}));
  EXPECT_EQ(database.ReadSourceFingerprints().at(2), 77);
}

TEST_F(DepthDatabaseTest, NoticesOtherKeypointsOfTheSameNumber) {
  WriteAll();
  Execute(
      "UPDATE keypoints SET data = zeroblob(length(data)) "
      "WHERE image_id = 1");
  ExpectReadFails(
      [](const auto& database) { database.ReadAllKeypointDepths(); },
      {"image a.jpg has 3 key points",
       "for other 3",
       "run depth_importer again"});
  EXPECT_EQ(
      DepthDatabase(path_, Mode::READ_ONLY).ReadSourceFingerprints().count(1),
      0);
}

TEST_F(DepthDatabaseTest, NoticesThatFeaturesWereExtractedAgain) {
  WriteAll();
  Execute("DELETE FROM keypoints WHERE image_id = 1");
  ExpectReadFails(
      [](const auto& database) { database.ReadAllKeypointDepths(); },
      {"image a.jpg has 0 key points",
       "for 3",
       "deleted since: extract them and run depth_importer again"});
  ExpectReadFails([](const auto& database) { database.ReadPairGeometries(); },
                  {"pair a.jpg - b.jpg", "run depth_geometric_verifier"});
}

TEST_F(DepthDatabaseTest, NamesDamagedRow) {
  WriteAll();
  Execute("UPDATE dgsfm_depth_maps SET data = x'0102' WHERE image_id = 1");
  ExpectReadFails([](const auto& database) { database.ReadDepthMap(1); },
                  {"image a.jpg", "depth_importer again"});
  Execute("UPDATE dgsfm_depth_maps SET width = 1000000 WHERE image_id = 2");
  ExpectReadFails([](const auto& database) { database.ReadDepthMap(2); },
                  {"image b.jpg", "1000000 x 2"});
  Execute("UPDATE dgsfm_keypoint_depths SET rows = 4 WHERE image_id = 2");
  ExpectReadFails(
      [](const auto& database) { database.ReadAllKeypointDepths(); },
      {"image b.jpg", "damaged"});
  WriteAll();
  Execute("UPDATE dgsfm_keypoint_depths SET focal_length = -1");
  ExpectReadFails(
      [](const auto& database) { database.ReadAllKeypointDepths(); },
      {"image a.jpg", "damaged"});
  for (const char* damage : {"status = 77",
                             "rows = 3",
                             "qvec = zeroblob(32)",
                             "tvec = zeroblob(16)",
                             "scale = -1",
                             "log_scale_stddev = -1",
                             "depth_verified = x'01'"}) {
    WriteAll();
    Execute(std::string("UPDATE dgsfm_pair_geometries SET ") + damage);
    ExpectReadFails([](const auto& database) { database.ReadPairGeometries(); },
                    {"pair a.jpg - b.jpg", "damaged", "--restart 1"});
  }
}

TEST_F(DepthDatabaseTest, GivesUpOnLockedDatabase) {
  SqliteConnection writer(path_, SqliteConnection::Mode::READ_WRITE);
  writer.Execute("BEGIN IMMEDIATE");
  DepthDatabase database(
      path_, Mode::READ_WRITE, std::chrono::milliseconds(20));
  EXPECT_THAT([&] { database.DeleteAllPairGeometries(); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(path_), HasSubstr("locked"))));
}

TEST_F(DepthDatabaseTest, RefusesFilesThatAreNoColmapDatabase) {
  const std::string dir = fs::path(path_).parent_path();
  EXPECT_THROW(DepthDatabase(dir + "/none.db", Mode::READ_WRITE),
               std::runtime_error);
  EXPECT_FALSE(fs::exists(dir + "/none.db"));
  SqliteConnection(dir + "/other.db", SqliteConnection::Mode::CREATE);
  EXPECT_THAT(
      [&] { DepthDatabase(dir + "/other.db", Mode::READ_WRITE); },
      ThrowsMessage<std::runtime_error>(HasSubstr("not a COLMAP database")));
}

TEST_F(DepthDatabaseTest, ColmapGoesOnWithItsDatabase) {
  const std::string path = fs::path(path_).parent_path() / "colmap38.db";
  {
    colmap::Database database(path);
    colmap::Camera camera;
    camera.InitializeWithName("PINHOLE", 500, 640, 480);
    database.WriteCamera(camera);
    for (const char* name : {"x.jpg", "y.jpg"}) {
      colmap::Image image;
      image.SetName(name);
      image.SetCameraId(1);
      database.WriteKeypoints(database.WriteImage(image),
                              {colmap::FeatureKeypoint(0.5f, 0.5f)});
    }
    database.WriteMatches(1, 2, {{0, 0}});
  }
  PairGeometry geometry;
  geometry.inlier_matches = {{0, 0}};
  geometry.depth_verified = {1};
  {
    DepthDatabase database(path, Mode::READ_WRITE);
    database.WriteDepthMap(1, TestDepthMap(), {DepthUnit::METRIC, {1}});
    database.WriteDepthMap(2, TestDepthMap(), {DepthUnit::METRIC, {2}});
    database.WritePairGeometries({{PairIdOfImages(1, 2), geometry}});
  }
  {
    colmap::Database database(path);
    EXPECT_EQ(database.NumCameras(), 1);
    EXPECT_EQ(database.ReadAllImages().size(), 2);
    EXPECT_EQ(database.ReadKeypoints(1).size(), 1);
    EXPECT_EQ(database.ReadMatches(1, 2).size(), 1);
  }
  SqliteConnection(path, SqliteConnection::Mode::READ_WRITE)
      .Execute("DELETE FROM images WHERE image_id = 2");
  const DepthDatabase database(path, Mode::READ_ONLY);
  EXPECT_TRUE(database.HasDepthMap(1));
  EXPECT_FALSE(database.HasDepthMap(2));
  EXPECT_EQ(database.ReadAllKeypointDepths().size(), 1);
  EXPECT_TRUE(database.ReadPairGeometries().empty());
}

}  // namespace
}  // namespace dgsfm
