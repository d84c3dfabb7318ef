#include "sfm/mapping/model_refinement.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/mapping/model_access.h"
#include "sfm/mapping/model_completion.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

SyntheticScene Ring() {
  SyntheticSceneOptions options;
  options.num_images = 16;
  options.num_points_per_image = 150;
  return SynthesizeScene(options);
}

colmap::point3D_t AnyLongPoint(const colmap::Reconstruction& model) {
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    if (model.Point3D(point_id).Track().Length() >= 4) return point_id;
  }
  return colmap::kInvalidPoint3DId;
}

// Moves the feature of the first observation of a point, which it returns.
colmap::TrackElement MoveAFeature(colmap::point3D_t point_id,
                                  const Eigen::Vector2d& shift_px,
                                  colmap::Reconstruction* model) {
  const colmap::TrackElement element =
      model->Point3D(point_id).Track().Elements().front();
  colmap::Point2D& feature =
      model->Image(element.image_id).Point2D(element.point2D_idx);
  feature.SetXY(feature.XY() + shift_px);
  return element;
}

size_t CountLongPoints(const colmap::Reconstruction& model) {
  size_t count = 0;
  for (const auto& [point_id, point] : model.Points3D()) {
    count += point.Track().Length() >= 3;
  }
  return count;
}

TEST(FilterObservations, KeepsAnExactModel) {
  colmap::Reconstruction model = ReconstructionFromSynthetic(Ring());
  ModelRefinementOptions options;
  options.min_num_triangulated_per_image = 0;
  options.min_triangulation_angle_deg = 0.01;
  EXPECT_EQ(FilterObservations(options, 1, &model), 0);
  EXPECT_EQ(FilterObservationsByAngle(0.01, &model), 0);
}

TEST(FilterObservations, TakesOutMovedFeatures) {
  colmap::Reconstruction model = ReconstructionFromSynthetic(Ring());
  const colmap::TrackElement moved =
      MoveAFeature(AnyLongPoint(model), {6, 0}, &model);
  ModelRefinementOptions options;
  options.min_num_triangulated_per_image = 0;
  options.min_triangulation_angle_deg = 0.01;
  colmap::Reconstruction tolerant = model;
  // Six pixels are within twice the four of the last round.
  EXPECT_EQ(FilterObservations(options, 2, &tolerant), 0);
  EXPECT_EQ(FilterObservations(options, 1, &model), 1);
  EXPECT_FALSE(
      model.Image(moved.image_id).Point2D(moved.point2D_idx).HasPoint3D());
}

TEST(FilterObservationsByAngle, TakesOutFeaturesBehindTheCamera) {
  colmap::Reconstruction model = ReconstructionFromSynthetic(Ring());
  const colmap::point3D_t point_id = AnyLongPoint(model);
  const size_t length = model.Point3D(point_id).Track().Length();
  const colmap::image_t image_id =
      model.Point3D(point_id).Track().Elements().front().image_id;
  const Rigid3d cam_from_world = CamFromWorld(model.Image(image_id));
  // The mirror image of the point at the camera's centre.
  model.Point3D(point_id).SetXYZ(2 * cam_from_world.TargetOriginInSource() -
                                 model.Point3D(point_id).XYZ());
  EXPECT_GE(FilterObservationsByAngle(2, &model), length - 1);
  EXPECT_FALSE(model.ExistsPoint3D(point_id));
}

TEST(FilterImages, NamesWhatIsMissing) {
  colmap::Reconstruction model = ReconstructionFromSynthetic(Ring());
  const colmap::image_t poor = 1;
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    const auto elements = model.Point3D(point_id).Track().Elements();
    for (const colmap::TrackElement& element : elements) {
      if (element.image_id == poor && model.ExistsPoint3D(point_id)) {
        model.DeleteObservation(element.image_id, element.point2D_idx);
      }
    }
  }
  const auto filtered = FilterImages(ModelRefinementOptions(), {}, &model);
  ASSERT_EQ(filtered.size(), 1);
  EXPECT_EQ(filtered.begin()->first, poor);
  EXPECT_EQ(filtered.begin()->second, "only 0 points after bundle adjustment");
  EXPECT_FALSE(model.IsImageRegistered(poor));
}

TEST(Retriangulate, RestoresDeletedPoints) {
  const SyntheticScene synthetic = Ring();
  const Scene scene = SceneFromSynthetic(synthetic);
  colmap::Reconstruction model = ReconstructionFromSynthetic(synthetic);
  const size_t num_points = CountLongPoints(model);
  const std::vector<colmap::point3D_t> point_ids = SortedPoints(model);
  for (size_t i = 0; i < point_ids.size(); i += 2) {
    model.DeletePoint3D(point_ids[i]);
  }
  const AgreeingMatches matches = MatchesThatAgree(
      scene, {}, PairVerificationOptions(), ModelRefinementOptions(), model);
  EXPECT_GT(Retriangulate(ModelRefinementOptions(), matches, &model), 0);
  // COLMAP leaves out tracks of two views; some others have small angles.
  EXPECT_GT(double(CountLongPoints(model)), 0.95 * double(num_points));
}

TEST(MatchesThatAgree, LeaveOutWhatEpipolarLinesCannotJudge) {
  const SyntheticScene synthetic = Ring();
  const Scene scene = SceneFromSynthetic(synthetic);
  const colmap::Reconstruction model = ReconstructionFromSynthetic(synthetic);
  PairGeometries pairs;
  pairs[PairIdOfImages(1, 2)].status = PairStatus::LOW_PAIR_SCORE;
  pairs[PairIdOfImages(2, 3)].status = PairStatus::TOO_FEW_INLIERS;
  const AgreeingMatches matches = MatchesThatAgree(
      scene, pairs, PairVerificationOptions(), ModelRefinementOptions(), model);
  EXPECT_EQ(matches.count(PairIdOfImages(1, 2)), 0);
  ASSERT_EQ(matches.count(PairIdOfImages(2, 3)), 1);
  // What is one point already.
  EXPECT_LT(matches.at(PairIdOfImages(2, 3)).size(),
            scene.matches.at(PairIdOfImages(2, 3)).size());
}

TEST(MatchesThatAgree, PointsOfOtherPairsJudgeThoseTakenOutByTranslation) {
  const SyntheticScene synthetic = Ring();
  Scene scene = SceneFromSynthetic(synthetic);
  const colmap::Reconstruction model = ReconstructionFromSynthetic(synthetic);
  const colmap::image_pair_t pair_id = PairIdOfImages(2, 3);
  PairGeometries pairs;
  pairs[pair_id].status = PairStatus::TRANSLATION_OUTLIER;
  const auto is_back = [&](const colmap::Reconstruction& by_model) {
    return MatchesThatAgree(scene,
                            pairs,
                            PairVerificationOptions(),
                            ModelRefinementOptions(),
                            by_model)
               .count(pair_id) > 0;
  };
  EXPECT_TRUE(is_back(model));
  // Look-alikes along the epipolar lines: where points half as far away again
  // would be seen.
  colmap::Reconstruction displaced = model;
  const Eigen::Vector3d center2 =
      CamFromWorld(model.Image(2)).TargetOriginInSource();
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    Eigen::Vector3d& point = displaced.Point3D(point_id).XYZ();
    point = center2 + 1.5 * (point - center2);
  }
  EXPECT_FALSE(is_back(displaced));
  // No point judges.
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    displaced.DeletePoint3D(point_id);
  }
  EXPECT_FALSE(is_back(displaced));
}

TEST(UpdatePointErrors, StoresTheMeanReprojectionError) {
  colmap::Reconstruction model = ReconstructionFromSynthetic(Ring());
  const colmap::point3D_t point_id = AnyLongPoint(model);
  MoveAFeature(point_id, {3, 4}, &model);
  UpdatePointErrors(&model);
  // Rounding of key points is all that the other observations have.
  EXPECT_NEAR(model.Point3D(point_id).Error(),
              5 / double(model.Point3D(point_id).Track().Length()),
              1e-3);
}

}  // namespace
}  // namespace dgsfm
