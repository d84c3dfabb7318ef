#include "sfm/view_graph/sensor_check.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr int kNumFrames = 10;

Eigen::Quaterniond Turn(double angle_deg, const Eigen::Vector3d& axis) {
  return Eigen::Quaterniond(
      Eigen::AngleAxisd(angle_deg * M_PI / 180, axis.normalized()));
}

// Frames of a rig that moves ahead and turns a little from one to the next,
// with cameras 1, 2, ... at the rig's origin.
class SensorCheck : public testing::Test {
 protected:
  explicit SensorCheck(double turn_deg = 3) {
    for (int i = 0; i < kNumFrames; ++i) {
      const Eigen::Quaterniond rotation =
          Turn(turn_deg * i, Eigen::Vector3d::UnitY());
      rig_from_world_.emplace_back(rotation,
                                   rotation * -Eigen::Vector3d(0, 0, i));
    }
    scene_.rigs.rigs[1].ref_camera_id = 1;
    for (int i = 0; i < kNumFrames; ++i) {
      scene_.rigs.frames[frame_t(i)].rig_id = 1;
    }
  }

  void AddCamera(const Eigen::Quaterniond& cam_from_rig) {
    const colmap::camera_t camera_id = colmap::camera_t(cameras_.size() + 1);
    cameras_.push_back({cam_from_rig, Eigen::Vector3d::Zero()});
    scene_.rigs.rigs[1].cam_from_rig[camera_id] = cameras_.back();
    scene_.cameras[camera_id].SetPriorFocalLength(true);
    for (int i = 0; i < kNumFrames; ++i) {
      scene_.rigs.frames[frame_t(i)].images[camera_id] =
          ImageIdOf(i, camera_id);
    }
  }

  static colmap::image_t ImageIdOf(int frame, colmap::camera_t camera_id) {
    return colmap::image_t(10 * frame) + camera_id;
  }

  Rigid3d CamFromWorld(int frame, colmap::camera_t camera_id) const {
    return cameras_[camera_id - 1] * rig_from_world_[size_t(frame)];
  }

  void AddPair(int frame1,
               colmap::camera_t camera_id1,
               int frame2,
               colmap::camera_t camera_id2) {
    PairGeometry pair;
    pair.status = PairStatus::VALID;
    pair.cam2_from_cam1 = CamFromWorld(frame2, camera_id2) *
                          CamFromWorld(frame1, camera_id1).Inverse();
    if (pair.cam2_from_cam1.translation.norm() == 0) {
      pair.Set(PairDegeneracy::ROTATION_ONLY);
    }
    pairs_[PairIdOfImages(ImageIdOf(frame1, camera_id1),
                          ImageIdOf(frame2, camera_id2))] = pair;
  }

  // The pairs of a camera from one frame to the next.
  void AddChain(colmap::camera_t camera_id) {
    for (int i = 1; i < kNumFrames; ++i)
      AddPair(i - 1, camera_id, i, camera_id);
  }

  // The rig of the scene has the camera wrong by this turn.
  void TurnCamera(colmap::camera_t camera_id, const Eigen::Quaterniond& turn) {
    auto& pose = scene_.rigs.rigs[1].cam_from_rig[camera_id];
    pose->rotation = turn * pose->rotation;
  }

  std::vector<colmap::camera_t> Contradicted() const {
    std::vector<colmap::camera_t> camera_ids;
    for (const auto& sensor : FindContradictedSensors(scene_, pairs_)) {
      camera_ids.push_back(sensor.camera_id);
    }
    return camera_ids;
  }

  std::vector<Rigid3d> rig_from_world_;
  std::vector<Rigid3d> cameras_;
  Scene scene_;
  PairGeometries pairs_;
};

class SensorCheckAhead : public SensorCheck {
 protected:
  SensorCheckAhead() : SensorCheck(/*turn_deg=*/0) {}
};

TEST_F(SensorCheck, FindsTheTurnedCameraAmongThreeThatMatch) {
  for (const double angle_deg : {0, 60, 120}) {
    AddCamera(Turn(angle_deg, Eigen::Vector3d::UnitY()));
  }
  for (int i = 0; i < kNumFrames; ++i) {
    AddPair(i, 1, i, 2);
    AddPair(i, 2, i, 3);
    AddPair(i, 1, i, 3);
  }
  EXPECT_THAT(Contradicted(), IsEmpty());
  TurnCamera(3, Turn(8, Eigen::Vector3d::UnitX()));
  const auto contradicted = FindContradictedSensors(scene_, pairs_);
  ASSERT_EQ(contradicted.size(), 1);
  EXPECT_EQ(contradicted[0].camera_id, 3);
  EXPECT_NEAR(contradicted[0].error_deg, 8, 1e-6);
  EXPECT_FALSE(contradicted[0].by_motion);
}

TEST_F(SensorCheck, ComparesByThirdImages) {
  AddCamera(Eigen::Quaterniond::Identity());
  AddCamera(Turn(40, Eigen::Vector3d::UnitY()));
  // Images of one frame are not matched with each other.
  for (int i = 1; i < kNumFrames; ++i) {
    AddPair(i - 1, 1, i, 1);
    AddPair(i - 1, 1, i, 2);
  }
  EXPECT_THAT(Contradicted(), IsEmpty());
  TurnCamera(2, Turn(180, Eigen::Vector3d::UnitZ()));
  EXPECT_THAT(Contradicted(), ElementsAre(2));
}

TEST_F(SensorCheck, ToleratesWhatUnknownFocalLengthsMakeOfAngles) {
  AddCamera(Eigen::Quaterniond::Identity());
  AddCamera(Turn(90, Eigen::Vector3d::UnitY()));
  for (int i = 0; i < kNumFrames; ++i) AddPair(i, 1, i, 2);
  // 7 % of 90 degrees.
  TurnCamera(2, Turn(6.3, Eigen::Vector3d::UnitY()));
  EXPECT_THAT(Contradicted(), ElementsAre(2));
  scene_.cameras[2].SetPriorFocalLength(false);
  EXPECT_THAT(Contradicted(), IsEmpty());
}

TEST_F(SensorCheckAhead, ComparesCamerasWithoutCommonViewByMotion) {
  AddCamera(Eigen::Quaterniond::Identity());
  AddCamera(Turn(90, Eigen::Vector3d::UnitY()));
  AddCamera(Turn(180, Eigen::Vector3d::UnitY()));
  for (const colmap::camera_t camera_id : {1, 2, 3}) AddChain(camera_id);
  EXPECT_THAT(Contradicted(), IsEmpty());
  // The inverse of its pose.
  TurnCamera(2, Turn(-180, Eigen::Vector3d::UnitY()));
  const auto contradicted = FindContradictedSensors(scene_, pairs_);
  ASSERT_EQ(contradicted.size(), 1);
  EXPECT_EQ(contradicted[0].camera_id, 2);
  EXPECT_TRUE(contradicted[0].by_motion);
  EXPECT_NEAR(contradicted[0].error_deg, 180, 1e-6);
}

TEST_F(SensorCheck, ForgetsPosesWithAWarning) {
  AddCamera(Eigen::Quaterniond::Identity());
  AddCamera(Turn(20, Eigen::Vector3d::UnitY()));
  for (int i = 0; i < kNumFrames; ++i) AddPair(i, 1, i, 2);
  TurnCamera(2, Turn(-40, Eigen::Vector3d::UnitY()));
  MappingLog log;
  DropContradictedSensors(pairs_, &scene_, &log);
  EXPECT_TRUE(scene_.rigs.rigs[1].cam_from_rig.at(1));
  EXPECT_FALSE(scene_.rigs.rigs[1].cam_from_rig.at(2));
  ASSERT_EQ(log.warnings.size(), 1);
  EXPECT_THAT(log.warnings[0],
              testing::HasSubstr("the rotation between it and camera 1 is off "
                                 "by 40 degrees"));
}

}  // namespace
}  // namespace dgsfm
