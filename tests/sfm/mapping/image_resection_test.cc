#include "sfm/mapping/image_resection.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "tests/sfm/mapping/mapping_fixture.h"

namespace dgsfm {
namespace {

constexpr colmap::image_t kImage = 5;

// A ring of exact poses, half of whose matches are wrong.
class ImageResection : public MappingFixture {
 protected:
  ImageResection() {
    SyntheticSceneOptions synthetic;
    synthetic.num_images = 16;
    synthetic.num_points_per_image = 150;
    synthetic.outlier_match_ratio = 0.5;
    const SyntheticScene ring = SynthesizeScene(synthetic);
    scene_ = SceneFromSynthetic(ring);
    progress_.model = ReconstructionFromSynthetic(ring);
    truth_ = CamFromWorld(progress_.model.Image(kImage));
  }

  // Turns the image away from what it sees.
  void Misplace() {
    Rigid3d wrong = truth_;
    wrong.rotation =
        Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY()) * wrong.rotation;
    SetCamFromWorld(wrong, &progress_.model.Image(kImage));
  }

  ResectionSummary Resect() {
    return ResectImages(context_, pairs_, &progress_);
  }

  // Key points have no noise; a local optimisation of four points at least ends
  // far below a pixel.
  void ExpectTruth() {
    const Rigid3d found = CamFromWorld(progress_.model.Image(kImage));
    EXPECT_LT(found.rotation.angularDistance(truth_.rotation), 1e-4);
    EXPECT_LT((found.translation - truth_.translation).norm(),
              1e-3 * truth_.translation.norm());
  }

  Rigid3d truth_;
};

TEST_F(ImageResection, LeavesImagesThatAgree) {
  const ResectionSummary summary = Resect();
  EXPECT_EQ(summary.num_moved + summary.num_registered, 0);
  EXPECT_GT(progress_.model.Image(kImage).NumPoints3D(), 0);
}

TEST_F(ImageResection, MovesAnImageToWhatItSees) {
  Misplace();
  const ResectionSummary summary = Resect();
  EXPECT_EQ(summary.num_moved, 1);
  ExpectTruth();
  // Its tracks are completed from the new pose.
  EXPECT_EQ(progress_.model.Image(kImage).NumPoints3D(), 0);
}

TEST_F(ImageResection, RegistersAnImageWithoutPose) {
  progress_.model.DeRegisterImage(kImage);
  const ResectionSummary summary = Resect();
  EXPECT_EQ(summary.num_registered, 1);
  EXPECT_TRUE(progress_.model.IsImageRegistered(kImage));
  ExpectTruth();
}

TEST_F(ImageResection, LeavesImagesWithoutEvidence) {
  Misplace();
  // Pairs that imported scores exclude are none.
  for (const auto& [pair_id, matches] : scene_.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (image_id1 == kImage || image_id2 == kImage) {
      pairs_[pair_id].status = PairStatus::LOW_PAIR_SCORE;
    }
  }
  EXPECT_EQ(Resect().num_moved, 0);
}

TEST_F(ImageResection, LeavesRigsAlone) {
  Misplace();
  progress_.rigs.frames[kImage] = {};
  EXPECT_EQ(Resect().num_moved, 0);
}

}  // namespace
}  // namespace dgsfm
