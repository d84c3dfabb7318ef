#include "sfm/georeferencing/model_joining.h"

#include "colmap_ext/pose_access.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr colmap::camera_t kFirstNewCameraId = 10;

// A rig of the cameras 1 and 2, and two parts of two frames each; image 2 n - 1
// of camera 1 and image 2 n of camera 2 are frame n.
class ModelJoiningTest : public testing::Test {
 protected:
  ModelJoiningTest() {
    RigScene rig_scene;
    Rig& rig = rig_scene.rigs[1];
    rig.ref_camera_id = 1;
    rig.cam_from_rig = {
        {1, Rigid3d()},
        {2, Rigid3d(Eigen::Quaterniond::Identity(), Eigen::Vector3d::UnitX())}};
    for (frame_t frame_id = 1; frame_id <= 4; ++frame_id) {
      rig_scene.frames[frame_id] = {1,
                                    {{1, 2 * frame_id - 1}, {2, 2 * frame_id}}};
    }
    for (int part = 0; part < 2; ++part) {
      models_.push_back(std::make_unique<colmap::Reconstruction>());
      for (const colmap::camera_t camera_id : {1, 2}) {
        colmap::Camera camera;
        camera.InitializeWithName("PINHOLE", 1000, 1000, 1000);
        camera.SetCameraId(camera_id);
        models_[part]->AddCamera(camera);
      }
      for (colmap::image_t i = 4 * part + 1; i <= 4u * part + 4; ++i) {
        colmap::Image image;
        image.SetImageId(i);
        image.SetCameraId(i % 2 == 1 ? 1 : 2);
        image.SetName(std::to_string(i));
        SetCamFromWorld({Eigen::Quaterniond::Identity(),
                         Eigen::Vector3d(i % 2 == 1 ? 0 : 1, i, 0)},
                        &image);
        models_[part]->AddImage(image);
        models_[part]->RegisterImage(i);
      }
      ModelGeoreference& georeference = georeferences_.emplace_back();
      georeference.is_georeferenced = true;
      rigs_.push_back(rig_scene);
    }
  }

  void Join() {
    JoinGeoreferencedModels(
        kFirstNewCameraId, &models_, &georeferences_, &rigs_);
    ASSERT_EQ(models_.size(), 1);
    ASSERT_EQ(rigs_.size(), 1);
    EXPECT_EQ(models_[0]->NumRegImages(), 8);
  }

  // All images of frames have the cameras of their frames.
  void ExpectCamerasOfFrames() const {
    for (const auto& [frame_id, frame] : rigs_[0].frames) {
      for (const auto& [camera_id, image_id] : frame.images) {
        EXPECT_EQ(models_[0]->Image(image_id).CameraId(), camera_id);
        EXPECT_EQ(rigs_[0].rigs.at(frame.rig_id).cam_from_rig.count(camera_id),
                  1);
      }
    }
  }

  std::vector<std::unique_ptr<colmap::Reconstruction>> models_;
  std::vector<ModelGeoreference> georeferences_;
  std::vector<RigScene> rigs_;
};

TEST_F(ModelJoiningTest, EqualRigsBecomeOne) {
  Join();
  EXPECT_EQ(models_[0]->NumCameras(), 2);
  EXPECT_EQ(rigs_[0].rigs.size(), 1);
  EXPECT_EQ(rigs_[0].frames.size(), 4);
  ExpectCamerasOfFrames();
}

TEST_F(ModelJoiningTest, RigWithOtherIntrinsicsIsOneOfItsOwn) {
  models_[1]->Camera(2).SetFocalLengthX(1010);
  const auto cam_from_rig = rigs_[0].rigs.at(1).cam_from_rig.at(2);
  Join();
  // Camera 1 is the same, but can be part of one rig only.
  EXPECT_EQ(models_[0]->NumCameras(), 4);
  ASSERT_EQ(rigs_[0].rigs.size(), 2);
  const Rig& added = rigs_[0].rigs.at(2);
  EXPECT_EQ(added.ref_camera_id, kFirstNewCameraId);
  EXPECT_EQ(added.cam_from_rig.at(kFirstNewCameraId + 1)->translation,
            cam_from_rig->translation);
  EXPECT_EQ(models_[0]->Camera(kFirstNewCameraId + 1).FocalLengthX(), 1010);
  EXPECT_EQ(rigs_[0].frames.size(), 4);
  EXPECT_EQ(rigs_[0].frames.at(1).rig_id, 1);
  EXPECT_EQ(rigs_[0].frames.at(3).rig_id, 2);
  ExpectCamerasOfFrames();
}

TEST_F(ModelJoiningTest, RigWithOtherPosesIsOneOfItsOwn) {
  rigs_[1].rigs.at(1).cam_from_rig.at(2)->translation.x() = 1.01;
  Join();
  EXPECT_EQ(models_[0]->NumCameras(), 4);
  ASSERT_EQ(rigs_[0].rigs.size(), 2);
  EXPECT_EQ(rigs_[0]
                .rigs.at(2)
                .cam_from_rig.at(kFirstNewCameraId + 1)
                ->translation.x(),
            1.01);
  EXPECT_EQ(rigs_[0].rigs.at(1).cam_from_rig.at(2)->translation.x(), 1);
  ExpectCamerasOfFrames();
}

TEST_F(ModelJoiningTest, ModelsWithoutPositionsStayApart) {
  georeferences_[1].is_georeferenced = false;
  JoinGeoreferencedModels(kFirstNewCameraId, &models_, &georeferences_, &rigs_);
  EXPECT_EQ(models_.size(), 2);
  EXPECT_EQ(rigs_.size(), 2);
}

}  // namespace
}  // namespace dgsfm
