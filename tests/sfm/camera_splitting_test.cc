#include "sfm/camera_splitting.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using CameraIds = std::vector<colmap::camera_t>;

// Camera 1 of images 1 to 8, and camera 5 of image 9.
Scene TwoEntries() {
  Scene scene;
  for (const colmap::camera_t id : {1, 5}) {
    colmap::Camera camera;
    camera.SetCameraId(id);
    camera.InitializeWithName("SIMPLE_RADIAL", 500, 640, 480);
    scene.cameras.emplace(id, camera);
    scene.exif[id].camera = "make|model";
    scene.focal_priors[id] = {500, 0.05};
  }
  for (colmap::image_t id = 1; id <= 9; ++id) {
    colmap::Image image;
    image.SetImageId(id);
    image.SetCameraId(id == 9 ? 5 : 1);
    scene.images.emplace(id, image);
  }
  return scene;
}

TEST(SplitCameras, EachImageGetsACameraWithAllThatIsKnown) {
  Scene scene = TwoEntries();
  EXPECT_EQ(SharedCameras(scene), std::set<colmap::camera_t>({1}));
  CameraBeliefs beliefs = GivenBeliefs(scene);
  CameraOrigins origins;
  SplitCameras({1}, &scene, &origins);
  EXPECT_TRUE(SharedCameras(scene).empty());
  EXPECT_EQ(scene.images.at(1).CameraId(), 1);
  EXPECT_EQ(scene.images.at(2).CameraId(), 6);
  EXPECT_EQ(scene.images.at(9).CameraId(), 5);
  EXPECT_EQ(origins.size(), 7);
  EXPECT_EQ(origins.at(12), 1);
  EXPECT_EQ(scene.cameras.at(12).CameraId(), 12);
  EXPECT_EQ(scene.cameras.at(12).Params(), scene.cameras.at(1).Params());

  AddSplitCameras(origins, &beliefs);
  EXPECT_EQ(beliefs.given.size(), 9);
  EXPECT_EQ(beliefs.labels.at(12), beliefs.labels.at(1));
  EXPECT_EQ(beliefs.focal_priors.at(12).focal_px, 500);
}

// The greatest id, 2^32 - 1, stands for no camera.
TEST(SplitCameras, IdsGoOnFromOneAfterTheGreatest) {
  Scene scene;
  constexpr colmap::camera_t kLastId = colmap::kInvalidCameraId - 1;
  for (const colmap::camera_t id : {colmap::camera_t(1), kLastId}) {
    colmap::Camera camera;
    camera.SetCameraId(id);
    camera.InitializeWithName("SIMPLE_RADIAL", 500, 640, 480);
    scene.cameras.emplace(id, camera);
  }
  for (colmap::image_t id = 1; id <= 3; ++id) {
    colmap::Image image;
    image.SetImageId(id);
    image.SetCameraId(kLastId);
    scene.images.emplace(id, image);
  }
  CameraOrigins origins;
  SplitCameras({kLastId}, &scene, &origins);
  EXPECT_EQ(origins, CameraOrigins({{2, kLastId}, {3, kLastId}}));
  EXPECT_EQ(scene.images.at(1).CameraId(), kLastId);
  EXPECT_EQ(scene.images.at(2).CameraId(), 2);
  EXPECT_EQ(scene.images.at(3).CameraId(), 3);
  EXPECT_EQ(scene.cameras.at(3).CameraId(), 3);
}

TEST(UntieImages, FewLeaveAndManyEndTheGroup) {
  Scene scene = TwoEntries();
  CameraOrigins origins;
  SplitCameras({1}, &scene, &origins);
  // The entry and another camera were one group.
  CameraGroup group;
  group.camera_ids = {1, 5};
  std::vector<CameraGroup> groups = {group};
  UntieImages(scene, origins, {3, 4}, &groups);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].camera_ids, CameraIds({1, 5, 6, 9, 10, 11, 12}));

  groups = {group};
  UntieImages(scene, origins, {3, 4, 5}, &groups);
  EXPECT_TRUE(groups.empty());

  // The entry was no group before.
  groups.clear();
  UntieImages(scene, origins, {3, 4}, &groups);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].camera_ids, CameraIds({1, 6, 9, 10, 11, 12}));
}

TEST(JoinedCameraIds, LargestPartHasTheIdOfTheEntry) {
  Scene scene = TwoEntries();
  CameraOrigins origins;
  SplitCameras({1}, &scene, &origins);
  colmap::Reconstruction model;
  for (const auto& [camera_id, camera] : scene.cameras) model.AddCamera(camera);
  CameraGroup small, large;
  small.camera_ids = {1, 6};
  large.camera_ids = {7, 8, 9, 10, 11};
  const auto joined = JoinedCameraIds(origins, {small, large}, model);
  EXPECT_EQ(joined.size(), 9);
  for (const colmap::camera_t id : large.camera_ids)
    EXPECT_EQ(joined.at(id), 1);
  // The id of the entry is not theirs any more.
  EXPECT_EQ(joined.at(1), 7);
  EXPECT_EQ(joined.at(6), 7);
  EXPECT_EQ(joined.at(12), 12);
  EXPECT_EQ(joined.at(5), 5);
}

TEST(JoinedCameraIds, OneGroupIsTheEntryAgain) {
  Scene scene = TwoEntries();
  CameraOrigins origins;
  SplitCameras({1}, &scene, &origins);
  colmap::Reconstruction model;
  CameraGroup group;
  // The first image is in no model.
  for (colmap::camera_t id = 6; id <= 12; ++id) {
    model.AddCamera(scene.cameras.at(id));
    group.camera_ids.push_back(id);
  }
  for (const auto& [camera_id, id] : JoinedCameraIds(origins, {group}, model)) {
    EXPECT_EQ(id, 1);
  }
}

}  // namespace
}  // namespace dgsfm
