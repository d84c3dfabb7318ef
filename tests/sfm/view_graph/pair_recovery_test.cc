#include "sfm/view_graph/pair_recovery.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A scene with the true rotations, and its verified pairs.
class PairRecoveryTest : public testing::Test {
 protected:
  PairRecoveryTest() {
    SyntheticSceneOptions options;
    options.num_images = 8;
    options.num_points_per_image = 150;
    options.image_noise_px = 0.5;
    const SyntheticScene synthetic = SynthesizeScene(options);
    scene_ = SceneFromSynthetic(synthetic);
    depths_ = KeypointDepthsFromSynthetic(synthetic);
    truth_ = ReconstructionFromSynthetic(synthetic);
    pairs_ = VerifyPairs(scene_, depths_, PairVerificationOptions());
    for (const auto& [image_id, image] : scene_.images) {
      rotations_.image_ids.push_back(image_id);
      rotations_.cam_from_world.push_back(
          CamFromWorld(truth_.Image(image_id)).rotation);
    }
  }

  size_t Recover() {
    const CameraBeliefs beliefs = GivenBeliefs(scene_);
    const FrameMembers frames;
    MappingLog log;
    RecoverPairs({options_, verification_, scene_, depths_, frames, beliefs},
                 rotations_,
                 &pairs_,
                 &log);
    if (log.stages.empty()) return 0;
    for (const auto& [name, value] : log.stages.back().figures) {
      if (name == "pairs_recovered") return size_t(value);
    }
    return 0;
  }

  DepthGlobalMapperOptions options_;
  PairVerificationOptions verification_;
  Scene scene_;
  KeypointDepthMap depths_;
  colmap::Reconstruction truth_;
  PairGeometries pairs_;
  ComponentRotations rotations_;
};

TEST_F(PairRecoveryTest, TrueRotationsBringPairsBack) {
  PairGeometry& pair = pairs_.at(PairIdOfImages(1, 2));
  ASSERT_EQ(pair.status, PairStatus::VALID);
  const size_t num_inliers = pair.NumInliers();
  pair.cam2_from_cam1.rotation =
      Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitX());
  pair.inlier_matches.resize(15);
  pair.depth_verified.resize(15);
  pair.Judge(PairStage::ROTATION_AVERAGING, PairStatus::ROTATION_OUTLIER);
  EXPECT_EQ(Recover(), 1);
  EXPECT_EQ(pair.status, PairStatus::VALID);
  EXPECT_EQ(pair.verdicts.back().stage, PairStage::ROTATION_RECOVERY);
  EXPECT_TRUE(pair.has_scale);
  // A few matches lie near the threshold.
  EXPECT_GE(double(pair.NumInliers()), 0.95 * double(num_inliers));
  const Rigid3d truth =
      CamFromWorld(truth_.Image(2)) * CamFromWorld(truth_.Image(1)).Inverse();
  // Half a pixel of noise on a focal length of 700.
  EXPECT_LT(pair.cam2_from_cam1.rotation.angularDistance(truth.rotation), 0.01);
}

TEST_F(PairRecoveryTest, MatchesThatContradictTheRotationsStayOut) {
  // The average says that image 2 looks elsewhere.
  for (auto& [pair_id, pair] : pairs_) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (image_id1 == 2 || image_id2 == 2) {
      pair.Judge(PairStage::ROTATION_AVERAGING, PairStatus::ROTATION_OUTLIER);
    }
  }
  rotations_.cam_from_world[1] =
      Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX()) *
      rotations_.cam_from_world[1];
  const PairGeometry before = pairs_.at(PairIdOfImages(1, 2));
  EXPECT_EQ(Recover(), 0);
  const PairGeometry& after = pairs_.at(PairIdOfImages(1, 2));
  EXPECT_EQ(after.status, PairStatus::ROTATION_OUTLIER);
  EXPECT_EQ(after.NumInliers(), before.NumInliers());
  EXPECT_EQ(after.verdicts.size(), before.verdicts.size());
}

TEST_F(PairRecoveryTest, OtherReasonsAndTheSwitchAreKept) {
  PairGeometry& pair = pairs_.at(PairIdOfImages(1, 2));
  pair.Judge(PairStage::VIEW_GRAPH_FILTER, PairStatus::LOW_PAIR_SCORE);
  EXPECT_EQ(Recover(), 0);
  EXPECT_EQ(pair.status, PairStatus::LOW_PAIR_SCORE);
  pair.Judge(PairStage::ROTATION_AVERAGING, PairStatus::ROTATION_OUTLIER);
  options_.skip_rotation_recovery = true;
  EXPECT_EQ(Recover(), 0);
  EXPECT_EQ(pair.status, PairStatus::ROTATION_OUTLIER);
}

}  // namespace
}  // namespace dgsfm
