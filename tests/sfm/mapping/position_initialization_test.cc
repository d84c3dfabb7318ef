#include "sfm/mapping/position_initialization.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "estimators/pose_metrics.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping/track_establishment.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// What the stages before hand over, exact.
struct Start {
  colmap::Reconstruction truth;
  KeypointDepthMap depths;
  PairGeometries pairs;
  ImageScales scales;
  std::vector<colmap::Track> tracks;
  // Rotated images without positions.
  colmap::Reconstruction model;
};

Start ExactStart() {
  SyntheticSceneOptions options;
  options.num_images = 16;
  options.num_points_per_image = 150;
  options.depth_noise.log_scale_stddev = 0.2;
  const SyntheticScene synthetic = SynthesizeScene(options);
  Start start;
  start.truth = ReconstructionFromSynthetic(synthetic);
  start.depths = KeypointDepthsFromSynthetic(synthetic);
  const Scene scene = SceneFromSynthetic(synthetic);
  start.pairs = VerifyPairs(scene, start.depths, PairVerificationOptions());
  for (const auto& [image_id, image] : synthetic.images) {
    start.scales[image_id] = image.depth_scale;
  }
  std::vector<colmap::image_t> image_ids;
  for (const auto& [camera_id, camera] : start.truth.Cameras()) {
    start.model.AddCamera(camera);
  }
  for (const auto& [image_id, image] : scene.images) {
    image_ids.push_back(image_id);
    colmap::Image rotated = image;
    SetCamFromWorld({CamFromWorld(start.truth.Image(image_id)).rotation,
                     Eigen::Vector3d::Zero()},
                    &rotated);
    start.model.AddImage(rotated);
  }
  start.tracks = EstablishTracks(ImageIndex(image_ids), start.pairs, {});
  return start;
}

size_t Initialize(Start* start,
                  const PositionInitializationOptions& options,
                  double min_triangulation_angle_deg = 1.5) {
  std::vector<colmap::image_t> image_ids;
  for (const auto& [image_id, scale] : start->scales) {
    image_ids.push_back(image_id);
  }
  return InitializePositions(ImageIndex(image_ids),
                             start->pairs,
                             start->depths,
                             start->scales,
                             start->tracks,
                             options,
                             min_triangulation_angle_deg,
                             &start->model);
}

std::map<std::string, Rigid3d> Poses(const colmap::Reconstruction& model) {
  std::map<std::string, Rigid3d> poses;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    poses[model.Image(image_id).Name()] = CamFromWorld(model.Image(image_id));
  }
  return poses;
}

TEST(InitializePositions, DepthGivesMetricCentres) {
  Start start = ExactStart();
  EXPECT_EQ(Initialize(&start, {}), 16);
  const PoseMetrics metrics =
      EvaluatePoses(Poses(start.truth), Poses(start.model));
  // Exact pairs; depth is stored as float, pairs stop at 1e-6.
  EXPECT_NEAR(metrics.truth_from_model_scale, 1, 1e-4);
  EXPECT_LT(metrics.max_center_error, 1e-3);
  EXPECT_GT(start.model.NumPoints3D(), 100);
}

TEST(InitializePositions, GrowsFromASeedWithoutDepth) {
  Start start = ExactStart();
  PositionInitializationOptions options;
  options.use_depth = false;
  EXPECT_EQ(Initialize(&start, options), 16);
  const PoseMetrics metrics =
      EvaluatePoses(Poses(start.truth), Poses(start.model));
  // The unit is that of the seed pair; errors are relative to it.
  EXPECT_LT(metrics.max_center_error, 1e-3);
}

TEST(InitializePositions, GrowsFromAveragedCentersWithoutDepth) {
  Start start = ExactStart();
  std::vector<colmap::image_t> image_ids;
  AveragedCenters centers;
  for (const auto& [image_id, scale] : start.scales) {
    image_ids.push_back(image_id);
    // The others follow by resection.
    if (image_id > 10) continue;
    centers[image_id] =
        CamFromWorld(start.truth.Image(image_id)).TargetOriginInSource();
  }
  // No pair could be a seed.
  EXPECT_EQ(InitializePositions(ImageIndex(image_ids),
                                /*pairs=*/{},
                                start.depths,
                                /*scales=*/{},
                                start.tracks,
                                {},
                                /*min_triangulation_angle_deg=*/1.5,
                                &start.model,
                                /*frames=*/{},
                                centers),
            16);
  const PoseMetrics metrics =
      EvaluatePoses(Poses(start.truth), Poses(start.model));
  EXPECT_NEAR(metrics.truth_from_model_scale, 1, 1e-4);
  EXPECT_LT(metrics.max_center_error, 1e-3);
}

TEST(InitializePositions, TriesOtherSeedsWhereTheBestOneDoesNotGrow) {
  PositionInitializationOptions options;
  options.use_depth = false;
  Start start = ExactStart();
  // The strongest pair sees what no third image sees.
  const auto is_alone = [](const colmap::TrackElement& element) {
    return element.image_id <= 2;
  };
  for (colmap::Track& track : start.tracks) {
    std::vector<colmap::TrackElement> alone, others;
    for (const colmap::TrackElement& element : track.Elements()) {
      (is_alone(element) ? alone : others).push_back(element);
    }
    track.SetElements(alone.size() == 2 ? alone : others);
  }
  start.pairs.at(PairIdOfImages(1, 2)).num_released_inliers = 100000;
  EXPECT_EQ(Initialize(&start, options), 14);
  EXPECT_FALSE(start.model.IsImageRegistered(1));
}

TEST(InitializePositions, TriangulationFollowsItsSmallestAngle) {
  PositionInitializationOptions options;
  options.use_depth = false;
  Start start = ExactStart();
  Initialize(&start, options);
  Start strict = ExactStart();
  // No two rays of a point are farther apart than opposite ones.
  Initialize(&strict, options, 181);
  EXPECT_GT(start.model.NumPoints3D(), 100);
  EXPECT_EQ(strict.model.NumPoints3D(), 0);
}

TEST(InitializePositions, ImagesWithoutAScaleFollowByResection) {
  Start start = ExactStart();
  const colmap::image_t without = start.scales.begin()->first;
  for (auto& [pair_id, pair] : start.pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (image_id1 == without || image_id2 == without) pair.DropScale();
  }
  start.depths.erase(without);
  EXPECT_EQ(Initialize(&start, {}), 16);
  const PoseMetrics metrics =
      EvaluatePoses(Poses(start.truth), Poses(start.model));
  EXPECT_NEAR(metrics.truth_from_model_scale, 1, 1e-4);
  EXPECT_LT(metrics.max_center_error, 1e-3);
}

TEST(InitializePositions, ImagesWithoutTracksStayUnregistered) {
  Start start = ExactStart();
  start.tracks.clear();
  PositionInitializationOptions options;
  options.use_depth = false;
  // The seed pair has the strongest pair's inliers, but no parallax by tracks.
  EXPECT_LE(Initialize(&start, options), 2);
  EXPECT_EQ(start.model.NumPoints3D(), 0);
}

}  // namespace
}  // namespace dgsfm
