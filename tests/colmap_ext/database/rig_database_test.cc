#include "colmap_ext/database/rig_database.h"

#include "colmap_ext/database/scene_database.h"
#include "tests/testing/colmap_database.h"
#include "tests/testing/test_dir.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;

// Two cameras, of which left/0.jpg, left/1.jpg and right/0.jpg, right/1.jpg
// are.
class RigDatabaseTest : public testing::TestWithParam<ColmapSchema> {
 protected:
  RigDatabaseTest()
      : dir_(CreateTestDir()),
        path_(dir_ + "/database.db"),
        writer_(path_, GetParam()) {
    writer_.AddCamera(0, 640, 480, {500, 320, 240});
    writer_.AddCamera(0, 640, 480, {500, 320, 240});
    writer_.AddImage("left/0.jpg", 1, {{1, 2}});
    writer_.AddImage("left/1.jpg", 1, {{1, 2}});
    writer_.AddImage("right/0.jpg", 2, {{1, 2}});
    writer_.AddImage("right/1.jpg", 2, {{1, 2}});
  }

  // Camera 2 becomes a second sensor of camera 1's rig, one metre to the right.
  void JoinCameras() {
    writer_.Execute(
        "DELETE FROM frame_data; DELETE FROM frames; "
        "DELETE FROM rigs WHERE rig_id = 2; "
        "INSERT INTO rig_sensors VALUES(1, 2, 0, "
        // (1, 0, 0, 0), (-1, 0, 0)
        "x'000000000000f03f000000000000000000000000000000000000000000000000"
        "000000000000f0bf00000000000000000000000000000000'); "
        "INSERT INTO frames VALUES(1, 1); INSERT INTO frames VALUES(2, 1); "
        "INSERT INTO frame_data VALUES(1, 1, 1, 0); "
        "INSERT INTO frame_data VALUES(1, 3, 2, 0); "
        "INSERT INTO frame_data VALUES(2, 2, 1, 0); "
        "INSERT INTO frame_data VALUES(2, 4, 2, 0)");
  }

  void ExpectFails(const std::string& words) {
    try {
      ReadRigs(path_, ReadScene(path_, SceneContent::IMAGES));
      ADD_FAILURE() << "read without an error";
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(path_));
      EXPECT_THAT(error.what(), HasSubstr(words));
    }
  }

  const std::string dir_;
  const std::string path_;
  ColmapDatabaseWriter writer_;
};

TEST_P(RigDatabaseTest, ReadsRigsOfSeveralCameras) {
  const Scene scene = ReadScene(path_, SceneContent::IMAGES);
  EXPECT_TRUE(ReadRigs(path_, scene).Empty());
  JoinCameras();
  const RigScene rigs = ReadRigs(path_, scene);
  ASSERT_EQ(rigs.rigs.size(), 1);
  EXPECT_EQ(rigs.rigs.at(1).ref_camera_id, 1);
  EXPECT_EQ(rigs.rigs.at(1).cam_from_rig.at(2)->translation,
            Eigen::Vector3d(-1, 0, 0));
  ASSERT_EQ(rigs.frames.size(), 2);
  const FrameMembers members = MembersOf(rigs);
  EXPECT_EQ(members.size(), 4);
  EXPECT_EQ(members.at(4).frame_id, 2);
  EXPECT_EQ(members.at(4).camera_id, 2);
  EXPECT_TRUE(HasBaseline(members, {1, 2, 3}));
  // One image of each frame, and images of no frame.
  EXPECT_FALSE(HasBaseline(members, {1, 2, 7}));
}

TEST_P(RigDatabaseTest, UnknownPosesConstrainNothing) {
  JoinCameras();
  writer_.Execute("UPDATE rig_sensors SET sensor_from_rig = NULL");
  const RigScene rigs = ReadRigs(path_, ReadScene(path_, SceneContent::IMAGES));
  EXPECT_EQ(CamerasToCalibrate(rigs, false), std::set<colmap::camera_t>{2});
  EXPECT_EQ(MembersOf(rigs).size(), 2);
  EXPECT_FALSE(HasBaseline(MembersOf(rigs), {1, 2, 3, 4}));
}

TEST_P(RigDatabaseTest, IgnoresOtherSensors) {
  JoinCameras();
  writer_.Execute(
      "UPDATE rig_sensors SET sensor_type = 1; "
      "DELETE FROM frame_data WHERE sensor_id = 2");
  EXPECT_TRUE(ReadRigs(path_, ReadScene(path_, SceneContent::IMAGES)).Empty());
}

// As scripts that thin out databases leave them.
TEST_P(RigDatabaseTest, FramesMayNameImagesThatAreGone) {
  JoinCameras();
  writer_.Execute("UPDATE frame_data SET data_id = 9 WHERE data_id = 4");
  const RigScene rigs = ReadRigs(path_, ReadScene(path_, SceneContent::IMAGES));
  // The frame of one image that is left constrains nothing.
  ASSERT_EQ(rigs.frames.size(), 1);
  EXPECT_EQ(rigs.frames.at(1).images.size(), 2);
}

TEST_P(RigDatabaseTest, RigsOfOneCameraMayNameWhatIsGone) {
  writer_.Execute(
      "UPDATE frame_data SET data_id = 9 WHERE data_id = 4; "
      "UPDATE images SET camera_id = 1; "
      "DELETE FROM cameras WHERE camera_id = 2");
  EXPECT_TRUE(ReadRigs(path_, ReadScene(path_, SceneContent::IMAGES)).Empty());
}

TEST_P(RigDatabaseTest, NamesWhatIsWrong) {
  JoinCameras();
  writer_.Execute("UPDATE rig_sensors SET sensor_from_rig = x'00'");
  ExpectFails("column sensor_from_rig holds something other than a multiple");
  writer_.Execute("UPDATE rig_sensors SET sensor_from_rig = zeroblob(56)");
  ExpectFails("rig 1: sensor_from_rig of camera 2 is not a pose");
  // A quaternion of denormal numbers cannot be normalised.
  writer_.Execute(
      "UPDATE rig_sensors SET sensor_from_rig = "
      "x'01000000000000000000000000000000000000000000000000000000"
      "00000000000000000000000000000000000000000000000000000000'");
  ExpectFails("rig 1: sensor_from_rig of camera 2 is not a pose");
  writer_.Execute(
      "UPDATE rig_sensors SET sensor_id = 7, sensor_from_rig = NULL");
  ExpectFails("rig 1: camera 7 does not exist");
  writer_.Execute(
      "UPDATE rig_sensors SET sensor_id = 2; "
      "UPDATE frame_data SET sensor_id = 1 WHERE data_id = 4");
  ExpectFails("image 4: its camera is not one of the rig");
}

TEST_P(RigDatabaseTest, ReadsConfigurations) {
  const Scene scene = ReadScene(path_, SceneContent::IMAGES);
  const std::string config = dir_ + "/rig_config.json";
  std::ofstream(config) << R"([{"cameras": [
      {"image_prefix": "left/", "ref_sensor": true},
      {"image_prefix": "right/", "cam_from_rig_rotation": [1, 0, 0, 0],
       "cam_from_rig_translation": [-1, 0, 0]}]}])";
  const RigScene rigs = ReadRigConfig(config, scene);
  EXPECT_EQ(rigs.frames.size(), 2);
  EXPECT_EQ(MembersOf(rigs).at(3).cam_from_rig.translation,
            Eigen::Vector3d(-1, 0, 0));
  const auto expect_fails = [&](const std::string& json,
                                const std::string& words) {
    std::ofstream(config) << json;
    try {
      ReadRigConfig(config, scene);
      ADD_FAILURE() << json;
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(config));
      EXPECT_THAT(error.what(), HasSubstr(words));
    }
  };
  expect_fails("[", "parse error");
  expect_fails(R"([{"cameras": [{"image_prefix": "left/"}]}])", "ref_sensor");
  expect_fails(R"([{"cameras": [{"image_prefix": "up/"}]}])",
               "no image has the prefix up/");
  expect_fails(R"([{"cameras": [{"image_prefix": ""}]}])", "several cameras");
  expect_fails(R"([{"cameras": [{"image_prefix": "left/",
                   "cam_from_rig_rotation": [1, 0, 0, 0]}]}])",
               "prefix left/ has one of");
  // Without an error, the rigs of the database would be lost.
  for (const char* json : {"[]", "{}", R"({"cameras": []})", "3"}) {
    expect_fails(json, "has to be a list of rigs");
  }
  expect_fails(R"(["rig"])", "a rig has to be an object {...}, not \"rig\"");
  expect_fails("[{}]", "a rig has no cameras");
  expect_fails(R"([{"cameras": [{"ref_sensor": true}]}])",
               "a camera has no image_prefix: {\"ref_sensor\":true}");
  expect_fails(R"([{"cameras": [{"image_prefix": "left/",
                   "cam_from_rig_rot": [1, 0, 0, 0]}]}])",
               "unknown key cam_from_rig_rot, not one of "
               "cam_from_rig_rotation, ");
  expect_fails(R"([{"cameras": [{"image_prefix": "left/",
                   "camera_params": [500, 320, 240]}]}])",
               "prefix left/ has camera_params, which is not read here: write "
               "it to the database by COLMAP's rig_configurator");
}

INSTANTIATE_TEST_SUITE_P(Schemas,
                         RigDatabaseTest,
                         testing::Values(ColmapSchema::V3_12,
                                         ColmapSchema::V4_2),
                         [](const auto& schema) {
                           return schema.param == ColmapSchema::V3_12 ? "V3_12"
                                                                      : "V4_2";
                         });

}  // namespace
}  // namespace dgsfm
