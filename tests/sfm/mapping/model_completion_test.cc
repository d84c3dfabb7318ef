#include "sfm/mapping/model_completion.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/mapping/model_access.h"
#include "tests/sfm/mapping/mapping_fixture.h"

namespace dgsfm {
namespace {

// All images of a ring were cropped, which moved the principal point of their
// camera; the model has a third of the points and the principal point held.
class HeldPrincipalPoint : public MappingFixture {
 protected:
  HeldPrincipalPoint() {
    SyntheticSceneOptions synthetic;
    synthetic.num_images = 20;
    synthetic.num_points_per_image = 300;
    synthetic.image_noise_px = 0.3;
    synthetic.known_focal_length = false;
    const SyntheticScene ring = SynthesizeScene(synthetic);
    scene_ = SceneFromSynthetic(ring);
    beliefs_ = GivenBeliefs(scene_);
    progress_.model = ReconstructionFromSynthetic(ring);
    for (auto& [image_id, image] : scene_.images) {
      for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
        Shift(&image.Point2D(i));
        Shift(&progress_.model.Image(image_id).Point2D(i));
      }
    }
    const std::vector<colmap::point3D_t> point_ids =
        SortedPoints(progress_.model);
    for (size_t i = 0; i < point_ids.size(); ++i) {
      if (i % 3 > 0) progress_.model.DeletePoint3D(point_ids[i]);
    }
    progress_.beliefs = beliefs_;
    progress_.final_loss_scales.soft_l1_px =
        options_.refinement.bundle_adjustment.loss_scale_px;
    for (const auto& [camera_id, camera] : progress_.model.Cameras()) {
      progress_.beliefs.held_principal_points.insert(camera_id);
    }
    verification_.num_threads = 1;
  }

  void Shift(colmap::Point2D* point) { point->SetXY(point->XY() + shift_px_); }

  void Complete() { CompleteTracks(context_, pairs_, &progress_, &log_); }

  double PrincipalPointError() const {
    const colmap::Camera& camera = progress_.model.Camera(1);
    const Eigen::Vector2d center(camera.Width() / 2.0, camera.Height() / 2.0);
    return (Eigen::Vector2d(camera.PrincipalPointX(),
                            camera.PrincipalPointY()) -
            center - shift_px_)
        .norm();
  }

  const Eigen::Vector2d shift_px_ = {6, -4};
};

TEST_F(HeldPrincipalPoint, IsFreedByTheCompletedTracks) {
  Complete();
  EXPECT_TRUE(progress_.beliefs.held_principal_points.empty());
  // A third of the shift, well beyond what 0.3 px of noise leave.
  EXPECT_LT(PrincipalPointError(), shift_px_.norm() / 3);
}

TEST_F(HeldPrincipalPoint, StaysWithoutSelfCalibration) {
  options_.skip_self_calibration = true;
  Complete();
  EXPECT_FALSE(progress_.beliefs.held_principal_points.empty());
  EXPECT_EQ(PrincipalPointError(), shift_px_.norm());
}

}  // namespace
}  // namespace dgsfm
