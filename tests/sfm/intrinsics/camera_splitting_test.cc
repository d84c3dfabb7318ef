#include "sfm/intrinsics/camera_splitting.h"

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

ImageCameras SplitEntries() {
  ImageCameras cameras = CamerasOf(TwoEntries(), {1, 2, 3, 4, 5, 6, 7, 8, 9});
  SplitCameras({1}, &cameras);
  return cameras;
}

TEST(SplitCameras, EachImageGetsACameraWithAllThatIsKnown) {
  const Scene scene = TwoEntries();
  EXPECT_EQ(SharedCameras(CamerasOf(scene, {1, 2, 9})),
            std::set<colmap::camera_t>({1}));
  const ImageCameras cameras = SplitEntries();
  EXPECT_TRUE(SharedCameras(cameras).empty());
  EXPECT_EQ(cameras.camera_of_image.at(1), 1);
  EXPECT_EQ(cameras.camera_of_image.at(2), 7);
  EXPECT_EQ(cameras.camera_of_image.at(9), 5);
  EXPECT_EQ(cameras.origins.size(), 7);
  EXPECT_EQ(cameras.origins.at(13), 1);
  EXPECT_EQ(cameras.cameras.at(13).CameraId(), 13);
  EXPECT_EQ(cameras.cameras.at(13).Params(), scene.cameras.at(1).Params());

  CameraBeliefs beliefs = GivenBeliefs(scene);
  AddSplitCameras(cameras.origins, &beliefs);
  EXPECT_EQ(beliefs.given.size(), 9);
  EXPECT_EQ(beliefs.labels.at(13), beliefs.labels.at(1));
  EXPECT_EQ(beliefs.focal_priors.at(13).focal_px, 500);
}

TEST(SplitCameras, DoesNotDependOnTheOtherPartsOfAScene) {
  ImageCameras first = CamerasOf(TwoEntries(), {1, 2, 3});
  ImageCameras second = CamerasOf(TwoEntries(), {4, 5, 6});
  SplitCameras({1}, &first);
  SplitCameras({1}, &second);
  EXPECT_EQ(first.camera_of_image.at(3), 8);
  EXPECT_EQ(second.camera_of_image.at(4), 1);
  EXPECT_EQ(second.camera_of_image.at(5), 10);
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
  ImageCameras cameras = CamerasOf(scene, {1, 2, 3});
  SplitCameras({kLastId}, &cameras);
  EXPECT_EQ(cameras.origins, CameraOrigins({{3, kLastId}, {4, kLastId}}));
  EXPECT_EQ(cameras.camera_of_image.at(1), kLastId);
  EXPECT_EQ(cameras.cameras.at(4).CameraId(), 4);
}

TEST(UntieImages, FewLeaveAndManyEndTheGroup) {
  const ImageCameras cameras = SplitEntries();
  // The entry and another camera were one group.
  CameraGroup group;
  group.camera_ids = {1, 5};
  std::vector<CameraGroup> groups = {group};
  UntieImages(cameras, {3, 4}, &groups);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].camera_ids, CameraIds({1, 5, 7, 10, 11, 12, 13}));

  groups = {group};
  UntieImages(cameras, {3, 4, 5}, &groups);
  EXPECT_TRUE(groups.empty());

  // The entry was no group before.
  groups.clear();
  UntieImages(cameras, {3, 4}, &groups);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].camera_ids, CameraIds({1, 7, 10, 11, 12, 13}));
}

TEST(JoinedCameraIds, LargestPartHasTheIdOfTheEntry) {
  const ImageCameras cameras = SplitEntries();
  colmap::Reconstruction model;
  for (const auto& [camera_id, camera] : cameras.cameras) {
    model.AddCamera(camera);
  }
  CameraGroup small, large;
  small.camera_ids = {1, 7};
  large.camera_ids = {8, 9, 10, 11, 12};
  const auto joined = JoinedCameraIds(cameras.origins, {small, large}, model);
  EXPECT_EQ(joined.size(), 9);
  for (const colmap::camera_t id : large.camera_ids)
    EXPECT_EQ(joined.at(id), 1);
  // The id of the entry is not theirs any more.
  EXPECT_EQ(joined.at(1), 8);
  EXPECT_EQ(joined.at(7), 8);
  EXPECT_EQ(joined.at(13), 13);
  EXPECT_EQ(joined.at(5), 5);
}

TEST(JoinedCameraIds, OneGroupIsTheEntryAgain) {
  const ImageCameras cameras = SplitEntries();
  colmap::Reconstruction model;
  CameraGroup group;
  // The first image is in no model.
  for (colmap::camera_t id = 7; id <= 13; ++id) {
    model.AddCamera(cameras.cameras.at(id));
    group.camera_ids.push_back(id);
  }
  for (const auto& [camera_id, id] :
       JoinedCameraIds(cameras.origins, {group}, model)) {
    EXPECT_EQ(id, 1);
  }
}

}  // namespace
}  // namespace dgsfm
