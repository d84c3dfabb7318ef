#include "colmap_ext/synthetic/synthetic_scene.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "tests/testing/test_dir.h"

#include <colmap/base/database.h>
#include <colmap/base/essential_matrix.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

std::string FileBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::pair<colmap::image_t, colmap::image_t> ImageIds(
    colmap::image_pair_t pair_id) {
  std::pair<colmap::image_t, colmap::image_t> ids;
  colmap::Database::PairIdToImagePair(pair_id, &ids.first, &ids.second);
  return ids;
}

// Largest distance [1] of inliers from the epipolar plane of the pair's pose.
double MaxEpipolarError(const SyntheticScene& scene,
                        colmap::image_pair_t pair_id) {
  const SyntheticPair& pair = scene.pairs.at(pair_id);
  const auto [image_id1, image_id2] = ImageIds(pair_id);
  const auto ray = [&](colmap::image_t image_id, colmap::point2D_t idx) {
    const SyntheticImage& image = scene.images.at(image_id);
    return scene.cameras.at(image.camera_id)
        .ImageToWorld(image.keypoints[idx])
        .homogeneous()
        .normalized();
  };
  const Eigen::Matrix3d E = colmap::EssentialMatrixFromPose(
      pair.cam2_from_cam1.rotation.toRotationMatrix(),
      pair.cam2_from_cam1.translation.normalized());
  double max_error = 0;
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    if (!pair.is_inlier[i]) continue;
    const double error =
        ray(image_id2, pair.matches[i].point2D_idx2)
            .dot(E * ray(image_id1, pair.matches[i].point2D_idx1));
    max_error = std::max(max_error, std::abs(error));
  }
  return max_error;
}

SyntheticSceneOptions OptionsOf(SceneFamily family) {
  SyntheticSceneOptions options = SceneFamilyOptions(family);
  options.num_images = 30;
  options.num_points_per_image = 300;
  return options;
}

class SceneFamilies : public testing::TestWithParam<SceneFamily> {};

TEST_P(SceneFamilies, ObservationsAreExactWithoutNoise) {
  SyntheticSceneOptions options = OptionsOf(GetParam());
  options.camera.num_cameras = 0;
  options.camera.radial_distortion = -0.05;
  options.camera.max_log_focal_offset = 0.1;
  options.outlier_match_ratio = 0;
  options.depth_noise.log_scale_stddev = 0.3;
  const SyntheticScene scene = SynthesizeScene(options);
  ASSERT_EQ(scene.images.size(), 30);
  EXPECT_EQ(scene.cameras.size(), 30);
  size_t num_keypoints = 0;
  for (const auto& [image_id, image] : scene.images) {
    num_keypoints += image.keypoints.size();
    // Close-ups off the landmarks have fewest.
    EXPECT_GE(image.keypoints.size(), 20) << image.name;
    ASSERT_EQ(image.prior_depths.size(), image.keypoints.size());
    for (size_t i = 0; i < image.keypoints.size(); ++i) {
      const Eigen::Vector3d in_cam =
          image.cam_from_world * scene.points.at(image.point_idxs[i]);
      const Eigen::Vector2d xy =
          scene.cameras.at(image.camera_id).WorldToImage(in_cam.hnormalized());
      // Double precision at 1e3 px.
      EXPECT_LT((xy - image.keypoints[i]).norm(), 1e-9);
      // Depths are kept as floats.
      EXPECT_NEAR(
          image.depth_scale * image.prior_depths[i] / in_cam.z(), 1, 1e-6);
    }
  }
  // The last point drawn is seen by at most all images.
  EXPECT_NEAR(num_keypoints / 30., 300, 10);
  for (const auto& [pair_id, pair] : scene.pairs) {
    EXPECT_GE(pair.matches.size(), 20);
    // Undistortion is iterative (1e-10 in COLMAP).
    EXPECT_LT(MaxEpipolarError(scene, pair_id), 1e-8);
  }
}

TEST_P(SceneFamilies, PairsConnectAllImagesOfAnyNumber) {
  for (const int num_images : {10, 30, 100}) {
    SyntheticSceneOptions options = OptionsOf(GetParam());
    options.num_images = num_images;
    const SyntheticScene scene = SynthesizeScene(options);
    std::set<colmap::image_t> connected = {1};
    size_t num_before = 0;
    while (connected.size() > num_before) {
      num_before = connected.size();
      for (const auto& [pair_id, pair] : scene.pairs) {
        const auto [image_id1, image_id2] = ImageIds(pair_id);
        if (pair.is_false) continue;
        if (connected.count(image_id1) > 0) connected.insert(image_id2);
        if (connected.count(image_id2) > 0) connected.insert(image_id1);
      }
    }
    EXPECT_EQ(connected.size(), num_images);
  }
}

TEST_P(SceneFamilies, NamesAreReadBack) {
  EXPECT_EQ(SceneFamilyFromName(SceneFamilyName(GetParam())), GetParam());
  EXPECT_THROW(SceneFamilyFromName("rings"), std::runtime_error);
}

INSTANTIATE_TEST_SUITE_P(All,
                         SceneFamilies,
                         testing::ValuesIn(AllSceneFamilies()),
                         [](const auto& family) {
                           return SceneFamilyName(family.param);
                         });

Rigid3d TruePose(const SyntheticScene& scene, colmap::image_pair_t pair_id) {
  const auto [image_id1, image_id2] = ImageIds(pair_id);
  return scene.images.at(image_id2).cam_from_world *
         scene.images.at(image_id1).cam_from_world.Inverse();
}

TEST(SceneFamily, ClustersHangTogetherByTwoImages) {
  const SyntheticScene scene =
      SynthesizeScene(OptionsOf(SceneFamily::CLUSTERS));
  // 14 images each, and the last two.
  const auto part_of = [](colmap::image_t image_id) {
    return image_id <= 14 ? 0 : image_id <= 28 ? 1 : 2;
  };
  size_t num_matches_within = 0, num_matches_across = 0;
  std::set<int> parts_linked;
  for (const auto& [pair_id, pair] : scene.pairs) {
    const auto [image_id1, image_id2] = ImageIds(pair_id);
    const int part1 = part_of(image_id1), part2 = part_of(image_id2);
    EXPECT_FALSE(part1 == 0 && part2 == 1);
    if (part1 != part2) parts_linked.insert(part1);
    (part1 == part2 ? num_matches_within : num_matches_across) +=
        pair.matches.size();
  }
  EXPECT_EQ(parts_linked, std::set<int>({0, 1}));
  EXPECT_LT(num_matches_across, 0.1 * num_matches_within);
}

TEST(SyntheticScene, NeighborsReachFromMostToFewestCommonPoints) {
  SyntheticSceneOptions options = OptionsOf(SceneFamily::FACADE);
  options.max_num_neighbors = 3;
  const SyntheticScene scene = SynthesizeScene(options);
  const auto points_of = [&](colmap::image_t image_id) {
    const std::vector<int>& idxs = scene.images.at(image_id).point_idxs;
    return std::set<int>(idxs.begin(), idxs.end());
  };
  const std::set<int> points = points_of(1);
  size_t fewest = points.size(), most = 0;
  colmap::image_t fewest_id = 0, most_id = 0;
  for (colmap::image_t image_id = 2; image_id <= 30; ++image_id) {
    size_t num_common = 0;
    for (const int idx : points_of(image_id)) num_common += points.count(idx);
    if (num_common > most) {
      most = num_common;
      most_id = image_id;
    }
    // Ties go to the smaller id, which ranks higher.
    if (num_common >= 20 && num_common <= fewest) {
      fewest = num_common;
      fewest_id = image_id;
    }
  }
  EXPECT_EQ(scene.pairs.count(PairIdOfImages(1, most_id)), 1);
  EXPECT_EQ(scene.pairs.count(PairIdOfImages(1, fewest_id)), 1);
  EXPECT_LE(scene.pairs.size(), 3 * 30);
}

TEST(SceneFamily, RepeatsMatchDifferentBays) {
  const SyntheticScene scene = SynthesizeScene(OptionsOf(SceneFamily::REPEATS));
  int num_false = 0;
  for (const auto& [pair_id, pair] : scene.pairs) {
    const Rigid3d truth = TruePose(scene, pair_id);
    const double error =
        (truth.Inverse() * pair.cam2_from_cam1).translation.norm();
    if (!pair.is_false) {
      EXPECT_LT(error, 1e-9);
      continue;
    }
    ++num_false;
    // Off by some bays of 4 m.
    EXPECT_NEAR(error / 4, std::round(error / 4), 1e-9);
    EXPECT_GT(error, 3.9);
    const auto [image_id1, image_id2] = ImageIds(pair_id);
    for (const colmap::FeatureMatch& match : pair.matches) {
      EXPECT_NE(scene.images.at(image_id1).point_idxs[match.point2D_idx1],
                scene.images.at(image_id2).point_idxs[match.point2D_idx2]);
    }
  }
  EXPECT_GE(num_false, 20);
}

TEST(SceneFamily, LowParallaxHasBaselinesFarBelowDepths) {
  const SyntheticScene scene =
      SynthesizeScene(OptionsOf(SceneFamily::LOW_PARALLAX));
  for (const auto& [pair_id, pair] : scene.pairs) {
    // Surfaces are 8 m away and more, and images in sight of the same part of
    // them at most seven steps of 10 cm apart.
    EXPECT_LT(TruePose(scene, pair_id).translation.norm(), 8 / 10.);
  }
}

TEST(SceneFamily, PanoramasTurnAtOnePlaceButForTheirSway) {
  for (const double sway_m : {0.0, 0.05}) {
    SyntheticSceneOptions options = OptionsOf(SceneFamily::PANORAMA);
    options.sway_m = sway_m;
    const SyntheticScene scene = SynthesizeScene(options);
    double max_distance = 0;
    for (const auto& [image_id, image] : scene.images) {
      max_distance = std::max(
          max_distance,
          image.cam_from_world.TargetOriginInSource().cwiseAbs().maxCoeff());
    }
    EXPECT_LE(max_distance, sway_m + 1e-12);
    EXPECT_GE(max_distance, 0.8 * sway_m);
  }
}

TEST(SceneFamily, ForwardMotionIsAlongTheOpticalAxis) {
  const SyntheticScene scene = SynthesizeScene(OptionsOf(SceneFamily::FORWARD));
  for (colmap::image_t image_id = 1; image_id < 30; ++image_id) {
    const Eigen::Vector3d direction =
        TruePose(scene, PairIdOfImages(image_id, image_id + 1)).translation;
    // The target of 20 m moves by 0.5 m, the camera by 2 cm of 50.
    EXPECT_LT(direction.z(), -0.99 * direction.norm());
  }
}

TEST(SceneFamily, InternetCamerasDiffer) {
  const SyntheticScene scene =
      SynthesizeScene(OptionsOf(SceneFamily::INTERNET));
  std::set<size_t> widths;
  std::set<double> focal_lengths, distortions;
  int num_portrait = 0;
  for (const auto& [camera_id, camera] : scene.cameras) {
    widths.insert(camera.Width());
    focal_lengths.insert(camera.MeanFocalLength());
    distortions.insert(camera.Params(camera.ExtraParamsIdxs()[0]));
    num_portrait += camera.Height() > camera.Width();
  }
  EXPECT_GE(widths.size(), 25);
  EXPECT_EQ(focal_lengths.size(), 30);
  EXPECT_EQ(distortions.size(), 30);
  EXPECT_GE(num_portrait, 4);
  EXPECT_LE(num_portrait, 20);
  EXPECT_GT(*focal_lengths.rbegin() / *focal_lengths.begin(), 1.5);
  for (const auto& [image_id, image] : scene.images) {
    const Eigen::Vector2d size = ImageSize(scene.cameras.at(image.camera_id));
    for (const Eigen::Vector2d& xy : image.keypoints) {
      EXPECT_TRUE((xy.array() >= 0).all() && (size - xy).minCoeff() >= 0);
    }
    const DepthMap map = DepthMapFromSynthetic(scene, image_id, 10);
    EXPECT_EQ(map.width, static_cast<int>(size.x()) / 10);
  }
  EXPECT_FALSE(SceneFromSynthetic(scene).cameras.at(1).HasPriorFocalLength());
}

TEST(SyntheticScene, NoiseHasTheRequestedSize) {
  SyntheticSceneOptions options;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.3;
  options.no_depth_ratio = 0.25;
  options.depth_noise.log_scale_stddev = 0.2;
  options.depth_noise.log_field_stddev = 0.05;
  options.depth_noise.log_noise_stddev = 0.1;
  const SyntheticScene noisy = SynthesizeScene(options);
  const SyntheticScene exact = SynthesizeScene({});
  double sum_sq_px = 0, sum_sq_log = 0;
  size_t num_points = 0, num_depths = 0, num_matches = 0, num_inliers = 0;
  int num_without_depth = 0;
  for (const auto& [image_id, image] : noisy.images) {
    const SyntheticImage& truth = exact.images.at(image_id);
    num_without_depth += image.prior_depths.empty();
    for (size_t i = 0; i < truth.keypoints.size(); ++i) {
      ASSERT_EQ(image.point_idxs[i], truth.point_idxs[i]);
      sum_sq_px += (image.keypoints[i] - truth.keypoints[i]).squaredNorm();
      ++num_points;
      if (image.prior_depths.empty()) continue;
      sum_sq_log +=
          std::pow(std::log(image.prior_depths[i] * image.depth_scale /
                            truth.prior_depths[i]),
                   2);
      ++num_depths;
    }
  }
  for (const auto& [pair_id, pair] : noisy.pairs) {
    ASSERT_EQ(pair.is_inlier.size(), pair.matches.size());
    num_matches += pair.matches.size();
    const auto [image_id1, image_id2] = ImageIds(pair_id);
    for (size_t i = 0; i < pair.matches.size(); ++i) {
      const int point_idx1 =
          noisy.images.at(image_id1).point_idxs[pair.matches[i].point2D_idx1];
      const int point_idx2 =
          noisy.images.at(image_id2).point_idxs[pair.matches[i].point2D_idx2];
      EXPECT_EQ(pair.is_inlier[i], point_idx1 >= 0 && point_idx1 == point_idx2);
      num_inliers += pair.is_inlier[i];
    }
  }
  // About 8000 samples: 1 / sqrt(2 * 8000) = 0.8 %, five sigma.
  EXPECT_NEAR(std::sqrt(0.5 * sum_sq_px / num_points), 0.5, 0.02);
  // The field has four waves per image, so that its size is less certain:
  // log noise 0.1 and field 0.05 make 0.112, and at least 0.1.
  EXPECT_NEAR(std::sqrt(sum_sq_log / num_depths), 0.112, 0.012);
  EXPECT_EQ(num_without_depth, 5);
  // Rounded to a match per pair of at least 20.
  EXPECT_NEAR(1 - double(num_inliers) / num_matches, 0.3, 0.01);
}

TEST(SyntheticScene, DepthScalesHaveUnitMedian) {
  SyntheticSceneOptions options;
  options.num_images = 21;
  options.depth_noise.log_scale_stddev = 0.5;
  const SyntheticScene scene = SynthesizeScene(options);
  std::vector<double> scales;
  for (const auto& [image_id, image] : scene.images) {
    scales.push_back(image.depth_scale);
  }
  std::sort(scales.begin(), scales.end());
  EXPECT_DOUBLE_EQ(scales[10], 1);
  EXPECT_LT(scales[5], 0.95);
  EXPECT_GT(scales[15], 1.05);
}

TEST(SyntheticScene, FalsePairsAgreeWithAWrongPose) {
  SyntheticSceneOptions options;
  options.num_false_pairs = 5;
  options.outlier_match_ratio = 0.2;
  const SyntheticScene scene = SynthesizeScene(options);
  int num_false = 0;
  for (const auto& [pair_id, pair] : scene.pairs) {
    const auto [image_id1, image_id2] = ImageIds(pair_id);
    const Rigid3d truth = scene.images.at(image_id2).cam_from_world *
                          scene.images.at(image_id1).cam_from_world.Inverse();
    const double error =
        truth.rotation.angularDistance(pair.cam2_from_cam1.rotation);
    // Double precision of the pose composition.
    EXPECT_LT(MaxEpipolarError(scene, pair_id), 1e-8);
    if (pair.is_false) {
      ++num_false;
      EXPECT_GE(pair.matches.size(), 20);
      // Images without a common view are far apart on the ring.
      EXPECT_GT(error, 0.5);
    } else {
      EXPECT_LT(error, 1e-7);
    }
  }
  EXPECT_EQ(num_false, 5);
}

TEST(SyntheticScene, ComponentsShareNoPairs) {
  SyntheticSceneOptions options;
  options.num_images = 24;
  options.num_components = 2;
  const SyntheticScene scene = SynthesizeScene(options);
  int num_images[2] = {0, 0};
  for (const auto& [image_id, image] : scene.images) {
    ++num_images[image.component];
  }
  EXPECT_EQ(num_images[0], 12);
  EXPECT_EQ(num_images[1], 12);
  EXPECT_FALSE(scene.pairs.empty());
  for (const auto& [pair_id, pair] : scene.pairs) {
    const auto [image_id1, image_id2] = ImageIds(pair_id);
    EXPECT_EQ(scene.images.at(image_id1).component,
              scene.images.at(image_id2).component);
  }
}

TEST(SyntheticScene, InvalidOptionsAreNamed) {
  SyntheticSceneOptions options;
  options.outlier_match_ratio = 1;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_NE(error.find("outlier_match_ratio"), std::string::npos);
  EXPECT_THROW(SynthesizeScene(options), std::invalid_argument);
  options = {};
  options.num_images = 2;
  options.num_false_pairs = 1000;
  EXPECT_THROW(SynthesizeScene(options), std::invalid_argument);
}

TEST(SyntheticSceneIo, DatabaseIsDeterministicAndHoldsTheScene) {
  const std::string dir = CreateTestDir();
  SyntheticSceneOptions options;
  options.num_images = 8;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.2;
  options.known_focal_length = false;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const std::string path = dir + "/a.db";
  WriteSyntheticDatabase(synthetic, path);
  WriteSyntheticDatabase(SynthesizeScene(options), dir + "/b.db");
  EXPECT_EQ(FileBytes(path), FileBytes(dir + "/b.db"));
  EXPECT_THROW(WriteSyntheticDatabase(synthetic, path), std::runtime_error);
  EXPECT_THROW(WriteSyntheticDatabase(synthetic, dir + "/missing/c.db"),
               std::runtime_error);

  const Scene expected = SceneFromSynthetic(synthetic);
  const Scene scene = ReadScene(path);
  EXPECT_EQ(scene.cameras.at(1).Params(), expected.cameras.at(1).Params());
  EXPECT_FALSE(scene.cameras.at(1).HasPriorFocalLength());
  ASSERT_EQ(scene.images.size(), expected.images.size());
  for (const auto& [image_id, image] : scene.images) {
    const colmap::Image& truth = expected.images.at(image_id);
    EXPECT_EQ(image.Name(), truth.Name());
    ASSERT_EQ(image.NumPoints2D(), truth.NumPoints2D());
    // Databases hold floats: 1e3 px * 2^-24.
    EXPECT_LT((image.Point2D(0).XY() - truth.Point2D(0).XY()).norm(), 1e-4);
  }
  ASSERT_EQ(scene.matches.size(), expected.matches.size());
  for (const auto& [pair_id, matches] : expected.matches) {
    EXPECT_EQ(scene.matches.at(pair_id).size(), matches.size());
  }
}

TEST(SyntheticSceneIo, GroundTruthModelHasNoReprojectionError) {
  const SyntheticScene synthetic = SynthesizeScene({});
  colmap::Reconstruction model = ReconstructionFromSynthetic(synthetic);
  EXPECT_EQ(model.NumRegImages(), 20);
  EXPECT_GT(model.NumPoints3D(), 1000);
  // Throws away every observation beyond the threshold.
  EXPECT_EQ(model.FilterAllPoints3D(1e-6, 0), 0);
  const DepthMap map = DepthMapFromSynthetic(synthetic, 1, 10);
  EXPECT_EQ(map.width, 80);
  EXPECT_EQ(map.height, 60);
  EXPECT_GT(map.Coverage(), 0.03);
}

TEST(SyntheticRig, ImagesOfFramesAreRigid) {
  SyntheticSceneOptions options;
  options.family = SceneFamily::STREET;
  options.rig = SyntheticRig::CUBE;
  options.num_images = 18;
  options.num_points_per_image = 20;
  const SyntheticScene scene = SynthesizeScene(options);
  EXPECT_EQ(scene.cameras.size(), 6);
  const std::vector<Rigid3d> cams_from_rig = CamsFromRig(options.rig);
  for (int i = 0; i < 18; ++i) {
    const SyntheticImage& image = scene.images.at(i + 1);
    EXPECT_EQ(image.camera_id, 1 + i % 6);
    const Rigid3d expected =
        cams_from_rig[i % 6] * scene.images.at(i - i % 6 + 1).cam_from_world;
    EXPECT_LT(image.cam_from_world.rotation.angularDistance(expected.rotation),
              1e-9);
    EXPECT_LT((image.cam_from_world.translation - expected.translation).norm(),
              1e-9);
  }
  EXPECT_EQ(scene.images.at(9).name, "cam2/image0001.jpg");
  options.num_images = 20;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_THROW(SyntheticRigFromName("stereos"), std::runtime_error);
  EXPECT_EQ(SyntheticRigFromName("vehicle"), SyntheticRig::VEHICLE);
}

}  // namespace
}  // namespace dgsfm
