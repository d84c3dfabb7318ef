#include "sfm/global_mapping.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "estimators/pose_metrics.h"
#include "sfm/mapping/shared_center.h"
#include "tests/testing/test_dir.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

SyntheticSceneOptions SmallRing() {
  SyntheticSceneOptions options;
  options.num_images = 12;
  options.num_points_per_image = 150;
  options.depth_noise.log_scale_stddev = 0.2;
  return options;
}

struct Outcome {
  DepthGlobalMapperResult result;
  PairGeometries pairs;
  PoseMetrics metrics;  // of the largest model
};

std::map<std::string, Rigid3d> Poses(const colmap::Reconstruction& model) {
  std::map<std::string, Rigid3d> poses;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    const colmap::Image& image = model.Image(image_id);
    poses[image.Name()] = CamFromWorld(image);
  }
  return poses;
}

Outcome MapScene(const SyntheticScene& synthetic,
                 Scene scene,
                 KeypointDepthMap depths,
                 DepthGlobalMapperOptions options) {
  PairVerificationOptions verification;
  verification.num_threads = 1;
  Outcome outcome;
  outcome.pairs = VerifyPairs(scene, depths, verification);
  outcome.result = RunGlobalMapping(
      options, verification, PairScores(), &scene, &depths, &outcome.pairs);
  if (!outcome.result.models.empty()) {
    outcome.metrics =
        EvaluatePoses(Poses(ReconstructionFromSynthetic(synthetic)),
                      Poses(*outcome.result.models[0]));
  }
  return outcome;
}

Outcome MapSynthetic(const SyntheticScene& synthetic,
                     const DepthGlobalMapperOptions& options = {},
                     bool use_depth = true) {
  return MapScene(
      synthetic,
      SceneFromSynthetic(synthetic),
      use_depth ? KeypointDepthsFromSynthetic(synthetic) : KeypointDepthMap(),
      options);
}

double MaxError(const PoseMetrics& metrics) {
  return *std::max_element(metrics.relative_errors_deg.begin(),
                           metrics.relative_errors_deg.end());
}

// Missing pairs, whose error is infinite, count as 180 degrees.
double MeanError(const PoseMetrics& metrics) {
  double sum = 0;
  for (const double error_deg : metrics.relative_errors_deg) {
    sum += std::min(error_deg, 180.0);
  }
  return sum / double(metrics.relative_errors_deg.size());
}

// Radius of the ring of cameras is several metres.
constexpr double kSceneSize = 10;

TEST(GlobalMapping, NoiseFreeSceneIsExactAndMetric) {
  const SyntheticScene synthetic = SynthesizeScene(SmallRing());
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 12);
  // The project's bar for exact data: 1e-3 degrees, 1e-4 of the scene size,
  // scales within 1e-4. What is left is the solvers' convergence tolerance.
  EXPECT_LT(MaxError(outcome.metrics), 1e-3);
  EXPECT_LT(outcome.metrics.max_center_error, 1e-4 * kSceneSize);
  EXPECT_NEAR(outcome.metrics.truth_from_model_scale, 1, 1e-4);
  for (const auto& [image_id, scale] : outcome.result.depth_scales) {
    EXPECT_NEAR(scale / synthetic.images.at(image_id).depth_scale, 1, 1e-4);
  }
  EXPECT_EQ(outcome.result.depth_scales.size(), 12);
}

TEST(GlobalMapping, UnknownFocalLengthsAreFound) {
  SyntheticSceneOptions options = SmallRing();
  options.known_focal_length = false;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 12);
  // As above; bundle adjustment of exact data finds the exact focal length.
  EXPECT_LT(MaxError(outcome.metrics), 1e-2);
  for (const auto& [camera_id, camera] : outcome.result.models[0]->Cameras()) {
    const double truth = synthetic.cameras.at(camera_id).MeanFocalLength();
    EXPECT_NEAR(camera.MeanFocalLength() / truth, 1, 1e-4);
  }
}

TEST(GlobalMapping, KnownDistortionIsUsed) {
  // The ring seen by a fisheye lens and by one of strong distortion: key points
  // move along their rays' images, all else stays.
  SyntheticSceneOptions options = SmallRing();
  options.camera.focal_length_px = 400;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const std::vector<std::pair<std::string, std::vector<double>>> lenses = {
      {"OPENCV_FISHEYE", {400, 410, 405, 290, 0.02, -0.01, 2e-3, 0}},
      {"RADIAL", {420, 410, 290, -0.2, 0.04}}};
  for (const auto& [model, params] : lenses) {
    Scene scene = SceneFromSynthetic(synthetic);
    for (auto& [image_id, image] : scene.images) {
      colmap::Camera lens = scene.cameras.at(image.CameraId());
      lens.SetModelIdFromName(model);
      lens.SetParams(params);
      colmap::Image seen;
      seen.SetImageId(image_id);
      seen.SetName(image.Name());
      seen.SetCameraId(image.CameraId());
      std::vector<Eigen::Vector2d> xys;
      for (const colmap::Point2D& point2D : image.Points2D()) {
        xys.push_back(lens.WorldToImage(
            synthetic.cameras.at(image.CameraId()).ImageToWorld(point2D.XY())));
      }
      seen.SetPoints2D(xys);
      image = seen;
    }
    for (auto& [camera_id, camera] : scene.cameras) {
      camera.SetModelIdFromName(model);
      camera.SetParams(params);
    }
    const Outcome outcome =
        MapScene(synthetic, scene, KeypointDepthsFromSynthetic(synthetic), {});
    ASSERT_EQ(outcome.result.models.size(), 1) << model;
    EXPECT_EQ(outcome.metrics.num_registered, 12);
    // The bar for exact data, as above.
    EXPECT_LT(MaxError(outcome.metrics), 1e-2) << model;
    EXPECT_NEAR(outcome.metrics.truth_from_model_scale, 1, 1e-4);
  }
}

TEST(GlobalMapping, PlainGlobalSfmWithoutDepth) {
  const SyntheticScene synthetic = SynthesizeScene(SmallRing());
  const Outcome outcome =
      MapSynthetic(synthetic, DepthGlobalMapperOptions(), /*use_depth=*/false);
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 12);
  EXPECT_LT(MaxError(outcome.metrics), 1e-3);
  EXPECT_TRUE(outcome.result.depth_scales.empty());
}

TEST(GlobalMapping, ImagesWithoutDepthTakePart) {
  SyntheticSceneOptions options = SmallRing();
  options.no_depth_ratio = 0.4;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 12);
  EXPECT_LT(MaxError(outcome.metrics), 1e-3);
  EXPECT_NEAR(outcome.metrics.truth_from_model_scale, 1, 1e-4);
}

TEST(GlobalMapping, NoiseAndOutliersAreAveragedOut) {
  SyntheticSceneOptions options = SmallRing();
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.3;
  options.depth_noise.log_field_stddev = 0.05;
  options.depth_noise.log_noise_stddev = 0.02;
  options.depth_noise.outlier_ratio = 0.05;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 12);
  // The worst pair of eight seeds was off by 0.26 to 0.42 degrees, with free
  // focal length and distortion, across a ring of twelve images.
  EXPECT_LT(MaxError(outcome.metrics), 0.6);
  // The smooth depth field moves each image's scale by up to its 5 %.
  EXPECT_NEAR(outcome.metrics.truth_from_model_scale, 1, 0.05);
}

TEST(GlobalMapping, RandomFalsePairsCostNoImage) {
  SyntheticSceneOptions options = SmallRing();
  options.num_images = 24;
  options.image_noise_px = 0.5;
  options.num_false_pairs = 62;
  options.depth_noise = DepthModelFromName("network");
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  size_t num_false = 0;
  for (const auto& [pair_id, pair] : synthetic.pairs)
    num_false += pair.is_false;
  ASSERT_GE(double(num_false), 0.3 * synthetic.pairs.size());
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 24);
  // Rotations and directions together; measured 0.05 to 0.1.
  std::vector<double> errors_deg = outcome.metrics.relative_errors_deg;
  std::nth_element(errors_deg.begin(),
                   errors_deg.begin() + errors_deg.size() / 2,
                   errors_deg.end());
  EXPECT_LT(errors_deg[errors_deg.size() / 2], 0.5);
  for (const auto& [pair_id, pair] : outcome.pairs) {
    EXPECT_EQ(pair.status == PairStatus::VALID,
              !synthetic.pairs.at(pair_id).is_false);
  }
}

// Images of look-alike bays are matched as if they showed one and the same:
// rotations and depth scales of such pairs agree with all others, and only
// translations contradict.
TEST(GlobalMapping, LookAlikePlacesAreKeptApart) {
  SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::REPEATS);
  options.num_images = 20;
  options.num_points_per_image = 200;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_FALSE(outcome.result.models.empty());
  int num_false_pairs = 0, num_false_pairs_left = 0;
  for (const auto& [pair_id, pair] : outcome.pairs) {
    if (!synthetic.pairs.at(pair_id).is_false) continue;
    ++num_false_pairs;
    num_false_pairs_left += pair.status == PairStatus::VALID;
  }
  EXPECT_GE(num_false_pairs, 10);
  // Images at the end of the path may have more false pairs than true ones.
  EXPECT_LE(num_false_pairs_left, num_false_pairs / 4);

  DepthGlobalMapperOptions without;
  without.skip_translation_averaging = true;
  const double mean_without =
      MeanError(MapSynthetic(synthetic, without).metrics);
  EXPECT_LT(MeanError(outcome.metrics), mean_without / 2);
}

// Lengths of pairs by shared points contradict the false pairs where no depth
// does, or where depth is wrong.
TEST(GlobalMapping, LookAlikePlacesAreKeptApartWithoutGoodDepth) {
  for (const int seed : {0, 1, 2}) {
    SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::REPEATS);
    options.num_images = 16;
    options.num_points_per_image = 300;
    options.image_noise_px = 0.5;
    options.depth_noise = DepthModelFromName("useless");
    options.random_seed = seed;
    const SyntheticScene synthetic = SynthesizeScene(options);
    for (const bool use_depth : {false, true}) {
      const Outcome outcome = MapSynthetic(synthetic, {}, use_depth);
      ASSERT_FALSE(outcome.result.models.empty());
      // Folded models reach less than 60.
      EXPECT_GT(AreaUnderCurve(outcome.metrics.relative_errors_deg, {5})[0], 90)
          << "seed " << seed << ", with depth " << use_depth;
    }
  }
}

// Each image is matched with one, two or five that see the same on the other
// side: as many pairs as there are around the corners, or twice as many.
TEST(GlobalMapping, TwinFacadesFacingAwayAreNotFolded) {
  for (const int num_look_alikes : {1, 2, 5}) {
    for (const bool use_depth : {true, false}) {
      SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::TWINS);
      options.num_images = 20;
      options.max_num_look_alikes = num_look_alikes;
      options.image_noise_px = 0.5;
      options.depth_noise = DepthModelFromName("network");
      const SyntheticScene synthetic = SynthesizeScene(options);
      const Outcome outcome = MapSynthetic(synthetic, {}, use_depth);
      ASSERT_FALSE(outcome.result.models.empty());
      // One image on the wrong side would be a tenth of all pairs.
      EXPECT_GT(AreaUnderCurve(outcome.metrics.relative_errors_deg, {5})[0], 95)
          << num_look_alikes << ", with depth " << use_depth;
    }
  }
}

// Five images and one more that shares tracks of two views only, with one of
// them. Without depth nothing fixes its distance: it must not be placed at
// random.
TEST(GlobalMapping, OrphansArePlacedByDepthOrLeftOut) {
  SyntheticSceneOptions options = SmallRing();
  options.num_images = 24;
  SyntheticScene synthetic = SynthesizeScene(options);
  const colmap::image_t orphan = 6;
  for (auto it = synthetic.pairs.begin(); it != synthetic.pairs.end();) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(it->first);
    const bool stays =
        image_id2 < orphan || (image_id1 == orphan - 1 && image_id2 == orphan);
    it = stays ? std::next(it) : synthetic.pairs.erase(it);
  }
  // The orphan keeps those matches alone whose points no third image has.
  SyntheticPair& pair = synthetic.pairs.at(PairIdOfImages(orphan - 1, orphan));
  std::set<colmap::point2D_t> elsewhere;
  for (const auto& [pair_id, other] : synthetic.pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (image_id2 != orphan - 1) continue;
    for (const auto& match : other.matches) {
      elsewhere.insert(match.point2D_idx2);
    }
  }
  colmap::FeatureMatches two_view_matches;
  for (const auto& match : pair.matches) {
    if (elsewhere.count(match.point2D_idx1) == 0) {
      two_view_matches.push_back(match);
    }
  }
  pair.matches = two_view_matches;
  pair.is_inlier.assign(two_view_matches.size(), true);
  ASSERT_GE(two_view_matches.size(), 20);

  for (const bool use_depth : {true, false}) {
    const Outcome outcome = MapSynthetic(synthetic, {}, use_depth);
    ASSERT_EQ(outcome.result.models.size(), 1) << use_depth;
    const colmap::Reconstruction& model = *outcome.result.models[0];
    EXPECT_EQ(model.ExistsImage(orphan), use_depth);
    EXPECT_EQ(outcome.result.unregistered_images.count(orphan),
              use_depth ? 0 : 1);
    for (const double error_deg : outcome.metrics.relative_errors_deg) {
      // Missing images have infinite errors; the others are exact.
      if (std::isfinite(error_deg)) {
        EXPECT_LT(error_deg, 1e-2);
      }
    }
  }
}

TEST(GlobalMapping, UnrelatedDepthMapsDoNoHarm) {
  SyntheticSceneOptions options = SmallRing();
  options.image_noise_px = 0.5;
  options.num_points_per_image = 200;
  options.depth_noise = DepthModelFromName("useless");
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome with_depth = MapSynthetic(synthetic);
  const Outcome without_depth = MapSynthetic(synthetic, {}, false);
  ASSERT_FALSE(with_depth.result.models.empty());
  EXPECT_EQ(with_depth.metrics.num_registered,
            without_depth.metrics.num_registered);
  // The same matches and bundle adjustment: what differs is which of them
  // survive a verification with other random samples.
  EXPECT_LT(MaxError(with_depth.metrics),
            1.5 * MaxError(without_depth.metrics));
}

TEST(GlobalMapping, ImagesWithoutParallaxKeepFarPoints) {
  SyntheticSceneOptions scene_options;
  scene_options.family = SceneFamily::LOW_PARALLAX;
  scene_options.num_images = 12;
  scene_options.num_points_per_image = 200;
  scene_options.image_noise_px = 0.5;
  const SyntheticScene synthetic = SynthesizeScene(scene_options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  EXPECT_EQ(outcome.metrics.num_registered, 12);
  DepthGlobalMapperOptions options;
  options.refinement.min_num_triangulated_per_image = 0;
  const Outcome without = MapSynthetic(synthetic, options);
  // Baselines of 10 cm in a room: few points have 1.5 degrees of parallax.
  EXPECT_LT(MeanError(outcome.metrics), 0.7 * MeanError(without.metrics));
}

// Largest error of a relative rotation of the model's images [deg].
double MaxRotationErrorDeg(const SyntheticScene& synthetic,
                           const colmap::Reconstruction& model) {
  std::vector<Eigen::Quaterniond> world_from_world;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    world_from_world.push_back(
        CamFromWorld(model.Image(image_id)).rotation.conjugate() *
        synthetic.images.at(image_id).cam_from_world.rotation);
  }
  double max_error_rad = 0;
  for (const Eigen::Quaterniond& a : world_from_world) {
    for (const Eigen::Quaterniond& b : world_from_world) {
      max_error_rad = std::max(max_error_rad, a.angularDistance(b));
    }
  }
  return max_error_rad * 180 / M_PI;
}

SyntheticSceneOptions Panorama() {
  SyntheticSceneOptions options;
  options.family = SceneFamily::PANORAMA;
  options.num_images = 24;
  options.num_points_per_image = 200;
  options.image_noise_px = 0.5;
  options.known_focal_length = false;
  options.depth_noise.log_scale_stddev = 0.2;
  return options;
}

TEST(GlobalMapping, ImagesThatOnlyTurnShareACenter) {
  const SyntheticScene synthetic = SynthesizeScene(Panorama());
  for (const bool use_depth : {true, false}) {
    const Outcome outcome = MapSynthetic(synthetic, {}, use_depth);
    ASSERT_EQ(outcome.result.models.size(), 1);
    const colmap::Reconstruction& model = *outcome.result.models[0];
    EXPECT_EQ(model.NumRegImages(), 24);
    EXPECT_TRUE(IsAtOneCenter(model));
    EXPECT_LT(MaxRotationErrorDeg(synthetic, model), 0.1);
    for (const auto& [camera_id, camera] : model.Cameras()) {
      EXPECT_NEAR(camera.MeanFocalLength() / 700, 1, 0.005);
    }
    ASSERT_EQ(outcome.result.warnings.size(), 1);
    EXPECT_NE(outcome.result.warnings[0].find("share one centre"),
              std::string::npos);
    // All matches of the images are right.
    for (const auto& [pair_id, pair] : outcome.pairs) {
      EXPECT_EQ(pair.status, PairStatus::VALID);
    }
    if (!use_depth) continue;
    // Points at depth: the surfaces are 8 to 14 m away, 4 m up and down.
    EXPECT_EQ(outcome.result.units[0].unit, ModelUnit::METRES);
    const Eigen::Vector3d center =
        CamFromWorld(model.Image(1)).TargetOriginInSource();
    for (const auto& [point_id, point] : model.Points3D()) {
      const double distance = (point.XYZ() - center).norm();
      EXPECT_GT(distance, 8 / 1.1);
      EXPECT_LT(distance, 15 * 1.1);
    }
  }
}

TEST(GlobalMapping, ImagesThatSwayAreToldFromThoseThatOnlyTurn) {
  SyntheticSceneOptions options = Panorama();
  options.sway_m = 0.05;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  const colmap::Reconstruction& model = *outcome.result.models[0];
  EXPECT_EQ(model.NumRegImages(), 24);
  EXPECT_FALSE(IsAtOneCenter(model));
  EXPECT_LT(MaxRotationErrorDeg(synthetic, model), 0.2);
  ASSERT_EQ(outcome.result.warnings.size(), 1);
  EXPECT_NE(outcome.result.warnings[0].find("turn more than they move"),
            std::string::npos);
}

SyntheticSceneOptions LittleParallax(uint32_t seed) {
  SyntheticSceneOptions options;
  options.family = SceneFamily::LOW_PARALLAX;
  options.random_seed = seed;
  options.num_images = 16;
  options.num_points_per_image = 500;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.2;
  options.known_focal_length = false;
  options.camera.num_cameras = 0;
  return options;
}

TEST(GlobalMapping, LittleParallaxNeedsNoDepth) {
  // Averaged rotations of the second scene are off by more than the parallax:
  // rays enclose 3 degrees.
  for (const uint32_t seed : {0, 14}) {
    const SyntheticScene synthetic = SynthesizeScene(LittleParallax(seed));
    const Outcome outcome = MapSynthetic(synthetic, {}, /*use_depth=*/false);
    ASSERT_EQ(outcome.result.models.size(), 1);
    EXPECT_EQ(outcome.metrics.num_registered, 16);
    // Half a pixel of 700 is 0.04 degrees, steps of 10 cm in a room are 0.6.
    EXPECT_LT(MaxRotationErrorDeg(synthetic, *outcome.result.models[0]), 0.5);
    EXPECT_LT(MeanError(outcome.metrics), 3);
  }
}

// The start from one centre costs 2 % less here by chance.
TEST(GlobalMapping, LittleParallaxKeepsAGoodStartFromDepth) {
  SyntheticSceneOptions options = LittleParallax(2);
  options.num_images = 20;
  options.image_noise_px = 0.7;
  options.depth_noise = DepthModelFromName("network");
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 1);
  // 1.1 degrees; 3.1 from one centre.
  EXPECT_LT(MeanError(outcome.metrics), 2);
}

TEST(GlobalMapping, PairsThatAgreeWithTheModelReturn) {
  const SyntheticScene synthetic = SynthesizeScene(SmallRing());
  Scene scene = SceneFromSynthetic(synthetic);
  KeypointDepthMap depths = KeypointDepthsFromSynthetic(synthetic);
  PairVerificationOptions verification;
  verification.num_threads = 1;
  PairGeometries pairs = VerifyPairs(scene, depths, verification);
  PairGeometry& pair = pairs.at(PairIdOfImages(1, 2));
  ASSERT_EQ(pair.status, PairStatus::VALID);
  pair.status = PairStatus::LOW_INLIER_RATIO;
  DepthGlobalMapperOptions options;
  options.skip_rotation_recovery = true;
  RunGlobalMapping(
      options, verification, PairScores(), &scene, &depths, &pairs);
  EXPECT_EQ(pair.status, PairStatus::VALID);
  ASSERT_EQ(pair.verdicts.size(), 2);
  EXPECT_EQ(pair.verdicts[0].stage, PairStage::VERIFICATION);
  EXPECT_EQ(pair.verdicts[0].status, PairStatus::LOW_INLIER_RATIO);
  EXPECT_EQ(pair.verdicts[1].stage, PairStage::PAIR_JUDGING);
}

TEST(GlobalMapping, BoundedStartsLoseNoPoints) {
  SyntheticSceneOptions options = SmallRing();
  options.num_points_per_image = 400;
  const SyntheticScene synthetic = SynthesizeScene(options);
  DepthGlobalMapperOptions mapper_options;
  std::vector<Outcome> outcomes;
  for (const int min_num_images : {2000, 10}) {
    mapper_options.tracks.min_num_images_to_bound_start = min_num_images;
    mapper_options.tracks.max_num_start_observations_per_image = 60;
    outcomes.push_back(MapScene(synthetic,
                                SceneFromSynthetic(synthetic),
                                KeypointDepthsFromSynthetic(synthetic),
                                mapper_options));
    ASSERT_EQ(outcomes.back().result.models.size(), 1);
    // Noise of 0.5 px in 700 is 0.04 degrees; hundreds of points reduce it.
    EXPECT_LT(MeanError(outcomes.back().metrics), 0.05);
  }
  const double num_points = outcomes[0].result.models[0]->NumPoints3D();
  EXPECT_NEAR(outcomes[1].result.models[0]->NumPoints3D(),
              num_points,
              0.01 * num_points);
}

TEST(GlobalMapping, OneEntryOfSeveralZoomsIsSplit) {
  for (const double max_log_focal_offset : {0.0, 0.3}) {
    SyntheticSceneOptions options = SmallRing();
    options.image_noise_px = 0.5;
    options.num_points_per_image = 300;
    options.known_focal_length = false;
    options.camera.num_cameras = 0;
    options.camera.max_log_focal_offset = max_log_focal_offset;
    const SyntheticScene synthetic = SynthesizeScene(options);
    Scene scene = SceneFromSynthetic(synthetic);
    for (auto& [image_id, image] : scene.images) image.SetCameraId(1);
    while (scene.cameras.size() > 1) {
      scene.cameras.erase(std::prev(scene.cameras.end()));
    }
    for (const bool split_cameras : {true, false}) {
      DepthGlobalMapperOptions mapper_options;
      mapper_options.split_cameras = split_cameras;
      const Outcome outcome = MapScene(synthetic,
                                       scene,
                                       KeypointDepthsFromSynthetic(synthetic),
                                       mapper_options);
      ASSERT_FALSE(outcome.result.models.empty());
      const bool is_split = split_cameras && max_log_focal_offset > 0;
      EXPECT_EQ(outcome.result.models[0]->NumCameras() > 1, is_split);
      EXPECT_EQ(outcome.result.cameras.size(),
                outcome.result.models[0]->NumCameras());
      // The entry keeps its id, for the largest part.
      EXPECT_TRUE(outcome.result.models[0]->ExistsCamera(1));
      EXPECT_EQ(outcome.result.warnings.size(), is_split ? 1 : 0);
      if (max_log_focal_offset > 0 && !split_cameras) continue;
      EXPECT_EQ(outcome.metrics.num_registered, 12);
      // Half a pixel of 700 is 0.04 degrees; free focal lengths cost some.
      EXPECT_LT(MeanError(outcome.metrics), is_split ? 0.5 : 0.2);
    }
  }
}

TEST(GlobalMapping, EveryComponentBecomesAModel) {
  SyntheticSceneOptions options = SmallRing();
  options.num_images = 20;
  options.num_components = 2;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Outcome outcome = MapSynthetic(synthetic);
  ASSERT_EQ(outcome.result.models.size(), 2);
  EXPECT_EQ(outcome.result.models[0]->NumRegImages(), 10);
  EXPECT_EQ(outcome.result.models[1]->NumRegImages(), 10);
  EXPECT_TRUE(outcome.result.unregistered_images.empty());

  DepthGlobalMapperOptions only_largest;
  only_largest.multiple_models = false;
  const Outcome largest = MapSynthetic(synthetic, only_largest);
  EXPECT_EQ(largest.result.models.size(), 1);
  EXPECT_EQ(largest.result.unregistered_images.size(), 10);
  for (const auto& [image_id, reason] : largest.result.unregistered_images) {
    EXPECT_EQ(reason, "not connected to the largest model");
  }
}

TEST(GlobalMapping, SceneOfTwoImagesBecomesAModel) {
  SyntheticScene synthetic = SynthesizeScene(SmallRing());
  synthetic.images.erase(synthetic.images.upper_bound(2),
                         synthetic.images.end());
  const colmap::image_pair_t pair_id = PairIdOfImages(1, 2);
  synthetic.pairs = {{pair_id, synthetic.pairs.at(pair_id)}};
  for (const bool use_depth : {false, true}) {
    const Outcome outcome = MapSynthetic(synthetic, {}, use_depth);
    ASSERT_EQ(outcome.result.models.size(), 1);
    EXPECT_EQ(outcome.metrics.num_registered, 2);
    EXPECT_LT(MaxError(outcome.metrics), 1);
    EXPECT_EQ(outcome.result.depth_scales.size(), use_depth ? 2 : 0);
  }
}

TEST(GlobalMapping, TwoOfManyImagesAreNoModel) {
  SyntheticScene synthetic = SynthesizeScene(SmallRing());
  const colmap::image_pair_t pair_id = PairIdOfImages(1, 2);
  synthetic.pairs = {{pair_id, synthetic.pairs.at(pair_id)}};
  const Outcome outcome = MapSynthetic(synthetic);
  EXPECT_TRUE(outcome.result.models.empty());
  EXPECT_EQ(outcome.result.unregistered_images.at(1),
            "connected to only 1 other images");
}

TEST(GlobalMapping, EveryStageCanBeSwitchedOff) {
  const SyntheticScene synthetic = SynthesizeScene(SmallRing());
  using Options = DepthGlobalMapperOptions;
  for (bool Options::*skip : {&Options::skip_pair_scores,
                              &Options::skip_focal_averaging,
                              &Options::skip_reverification,
                              &Options::skip_scale_averaging,
                              &Options::skip_translation_averaging,
                              &Options::skip_static_background,
                              &Options::skip_depth_reliability,
                              &Options::skip_global_positioning,
                              &Options::skip_bundle_adjustment,
                              &Options::skip_self_calibration,
                              &Options::skip_camera_ties,
                              &Options::skip_loss_adaptation,
                              &Options::skip_image_resection,
                              &Options::skip_match_completion,
                              &Options::skip_pair_judging,
                              &Options::skip_retriangulation}) {
    Options options;
    options.*skip = true;
    const Outcome outcome = MapSynthetic(synthetic, options);
    ASSERT_EQ(outcome.result.models.size(), 1);
    EXPECT_EQ(outcome.metrics.num_registered, 12);
  }
}

TEST(GlobalMapping, ExplainsWhyNothingIsRegistered) {
  SyntheticScene synthetic = SynthesizeScene(SmallRing());
  synthetic.pairs.clear();
  const Outcome outcome = MapSynthetic(synthetic);
  EXPECT_TRUE(outcome.result.models.empty());
  ASSERT_EQ(outcome.result.unregistered_images.size(), 12);
  EXPECT_EQ(outcome.result.unregistered_images.at(1),
            "no matches with other images");
}

TEST(GlobalMapping, OneThreadGivesTheSameBytesTwice) {
  SyntheticSceneOptions options = SmallRing();
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.2;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const std::string dir = CreateTestDir();
  const Outcome first = MapSynthetic(synthetic);
  const Outcome second = MapSynthetic(synthetic);
  for (const std::string file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    first.result.models[0]->Write(dir);
    const std::string bytes = FileContent(dir + "/" + file);
    second.result.models[0]->Write(dir);
    EXPECT_FALSE(bytes.empty());
    EXPECT_TRUE(bytes == FileContent(dir + "/" + file)) << file;
  }
}

}  // namespace
}  // namespace dgsfm
