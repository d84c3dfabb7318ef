#include "sfm/mapping/track_completion.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/mapping/model_access.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A true model of exact key points, and the tracks of its points.
class AddTracksTest : public ::testing::Test {
 protected:
  AddTracksTest() {
    SyntheticSceneOptions options;
    options.num_images = 20;
    options.num_points_per_image = 300;
    options.image_noise_px = 0;
    truth_ = ReconstructionFromSynthetic(SynthesizeScene(options));
    for (const colmap::point3D_t point_id : SortedPoints(truth_)) {
      if (truth_.Point3D(point_id).Track().Length() < 3) {
        truth_.DeletePoint3D(point_id);
        continue;
      }
      tracks_.push_back(truth_.Point3D(point_id).Track());
    }
    model_ = truth_;
  }

  size_t Add(int num_threads = 1) {
    return AddTracks(tracks_, ModelRefinementOptions(), num_threads, &model_);
  }

  colmap::Reconstruction truth_;
  std::vector<colmap::Track> tracks_;
  colmap::Reconstruction model_;
};

TEST_F(AddTracksTest, BringsBackPointsAndObservations) {
  const std::vector<colmap::point3D_t> point_ids = SortedPoints(model_);
  ASSERT_GT(point_ids.size(), 20);
  for (size_t i = 0; i < point_ids.size(); ++i) {
    if (i % 3 == 0) {
      model_.DeletePoint3D(point_ids[i]);
    } else if (i % 3 == 1) {
      const colmap::TrackElement element =
          model_.Point3D(point_ids[i]).Track().Element(0);
      model_.DeleteObservation(element.image_id, element.point2D_idx);
    }
  }
  const size_t num_missing =
      truth_.ComputeNumObservations() - model_.ComputeNumObservations();
  EXPECT_EQ(Add(), num_missing);
  EXPECT_EQ(model_.NumPoints3D(), truth_.NumPoints3D());
  for (const colmap::point3D_t point_id : SortedPoints(model_)) {
    const colmap::TrackElement element =
        model_.Point3D(point_id).Track().Element(0);
    const colmap::point3D_t true_id =
        truth_.Image(element.image_id).Point2D(element.point2D_idx).Point3DId();
    // Exact rays meet to rounding.
    EXPECT_LT(
        (model_.Point3D(point_id).XYZ() - truth_.Point3D(true_id).XYZ()).norm(),
        1e-6);
  }
  EXPECT_EQ(Add(), 0);
}

TEST_F(AddTracksTest, LeavesOutWrongElements) {
  colmap::point3D_t point_id = 0;
  for (const colmap::point3D_t id : SortedPoints(model_)) {
    if (model_.Point3D(id).Track().Length() >= 4) point_id = id;
  }
  ASSERT_NE(point_id, 0);
  const colmap::Track track = model_.Point3D(point_id).Track();
  model_.DeletePoint3D(point_id);
  // Beyond the bound of eight pixels, and near enough that the others are at
  // the first intersection.
  const colmap::TrackElement wrong = track.Element(0);
  colmap::Point2D& feature =
      model_.Image(wrong.image_id).Point2D(wrong.point2D_idx);
  feature.SetXY(feature.XY() + Eigen::Vector2d(0, 16));
  EXPECT_EQ(Add(), track.Length() - 1);
  EXPECT_FALSE(feature.HasPoint3D());
}

TEST_F(AddTracksTest, GivesNoPointToImagesThatAreNotRegistered) {
  const colmap::image_t image_id = model_.RegImageIds().front();
  for (const colmap::point3D_t point_id : SortedPoints(model_)) {
    model_.DeletePoint3D(point_id);
  }
  model_.DeRegisterImage(image_id);
  EXPECT_GT(Add(), 0);
  EXPECT_EQ(model_.Image(image_id).NumPoints3D(), 0);
}

TEST_F(AddTracksTest, IsTheSameForAnyNumberOfThreads) {
  for (const colmap::point3D_t point_id : SortedPoints(model_)) {
    model_.DeletePoint3D(point_id);
  }
  const colmap::Reconstruction empty = model_;
  Add(1);
  const colmap::Reconstruction one = model_;
  model_ = empty;
  Add(3);
  ASSERT_EQ(SortedPoints(one), SortedPoints(model_));
  for (const colmap::point3D_t point_id : SortedPoints(one)) {
    EXPECT_EQ(one.Point3D(point_id).XYZ(), model_.Point3D(point_id).XYZ());
  }
}

}  // namespace
}  // namespace dgsfm
