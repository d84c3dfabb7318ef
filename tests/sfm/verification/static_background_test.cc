#include "sfm/verification/static_background.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/global_mapping.h"

#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct TestScene {
  Scene scene;
  KeypointDepthMap depths;
};

TestScene CreateRing() {
  SyntheticSceneOptions options;
  options.num_images = 10;
  options.num_points_per_image = 150;
  options.image_noise_px = 0.3;
  const SyntheticScene synthetic = SynthesizeScene(options);
  return {SceneFromSynthetic(synthetic),
          KeypointDepthsFromSynthetic(synthetic)};
}

// As if the objects turned before a wall three metres behind the camera's
// focus, with `num_points` key points of the same place in all images, which
// all pairs match.
void AddWall(int num_points, TestScene* test) {
  std::mt19937 random(0);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> noise(0, 0.3);
  std::vector<Eigen::Vector2d> wall(num_points);
  for (Eigen::Vector2d& xy : wall) {
    xy = {640 * uniform(random), 480 * uniform(random)};
  }
  std::map<colmap::image_t, colmap::point2D_t> first_idxs;
  for (auto& [image_id, image] : test->scene.images) {
    std::vector<Eigen::Vector2d> points;
    for (const colmap::Point2D& point : image.Points2D()) {
      points.push_back(point.XY());
    }
    first_idxs[image_id] = points.size();
    for (const Eigen::Vector2d& xy : wall) {
      points.emplace_back(xy.x() + noise(random), xy.y() + noise(random));
    }
    colmap::Image changed;
    changed.SetImageId(image_id);
    changed.SetCameraId(image.CameraId());
    changed.SetName(image.Name());
    changed.SetPoints2D(points);
    image = changed;
    test->depths.at(image_id).depths.resize(points.size(), 10);
  }
  for (const auto& [image_id1, first1] : first_idxs) {
    for (const auto& [image_id2, first2] : first_idxs) {
      if (image_id1 >= image_id2) continue;
      auto& matches = test->scene.matches[PairIdOfImages(image_id1, image_id2)];
      for (int k = 0; k < num_points; ++k) {
        matches.emplace_back(first1 + k, first2 + k);
      }
    }
  }
}

DepthGlobalMapperResult Map(TestScene test, PairGeometries* pairs) {
  PairVerificationOptions verification;
  verification.num_threads = 1;
  DepthGlobalMapperOptions options;
  *pairs = VerifyPairs(test.scene, test.depths, verification);
  const PairScores no_scores;
  return RunGlobalMapping(
      options, verification, no_scores, &test.scene, &test.depths, pairs);
}

TEST(FindStaticKeypoints, AreThoseOfTheBackground) {
  TestScene test = CreateRing();
  std::map<colmap::image_t, size_t> num_moving;
  for (const auto& [image_id, image] : test.scene.images) {
    num_moving[image_id] = image.NumPoints2D();
  }
  AddWall(400, &test);
  const PairGeometries pairs =
      VerifyPairs(test.scene, test.depths, PairVerificationOptions());
  const auto groups = FindStaticKeypoints(test.scene, pairs, 3);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].image_ids.size(), 10);
  for (const auto& [image_id, image] : test.scene.images) {
    for (size_t i = 0; i < image.NumPoints2D(); ++i) {
      EXPECT_EQ(groups[0].Contains(image_id, i), i >= num_moving.at(image_id));
    }
  }
  for (const auto& [pair_id, matches] :
       MatchesThatMove(test.scene, groups[0])) {
    EXPECT_EQ(matches.size() + 400, test.scene.matches.at(pair_id).size());
  }
}

TEST(FindStaticKeypoints, NeedStationaryPairs) {
  const TestScene test = CreateRing();
  const PairGeometries pairs =
      VerifyPairs(test.scene, test.depths, PairVerificationOptions());
  EXPECT_TRUE(FindStaticKeypoints(test.scene, pairs, 3).empty());
}

TEST(GlobalMapping, MapsWhatTurnsBeforeABackground) {
  TestScene test = CreateRing();
  AddWall(400, &test);
  for (const bool use_depth : {false, true}) {
    if (!use_depth) test.depths.clear();
    PairGeometries pairs;
    const DepthGlobalMapperResult result = Map(test, &pairs);
    ASSERT_EQ(result.models.size(), 1);
    EXPECT_EQ(result.models[0]->NumRegImages(), 10);
    ASSERT_EQ(result.warnings.size(), 1);
    EXPECT_NE(result.warnings[0].find("pairs are stationary"),
              std::string::npos);
    for (const auto& [point_id, point] : result.models[0]->Points3D()) {
      EXPECT_LT(point.Track().Length(), 10);
    }
    test = CreateRing();
    AddWall(400, &test);
  }
}

// Photos taken twice from a tripod have no second motion: all of their key
// points stay.
TEST(GlobalMapping, KeepsTheKeypointsOfBursts) {
  TestScene test = CreateRing();
  const colmap::image_t num_images = test.scene.images.size();
  const auto matches = test.scene.matches;
  const auto copy_of = [&](colmap::image_t image_id, int copy) {
    return colmap::image_t(image_id + copy * num_images);
  };
  for (colmap::image_t id = 1; id <= num_images; ++id) {
    colmap::FeatureMatches identity;
    for (size_t i = 0; i < test.scene.images.at(id).NumPoints2D(); ++i) {
      identity.emplace_back(i, i);
    }
    for (int copy = 1; copy < 3; ++copy) {
      colmap::Image image = test.scene.images.at(id);
      image.SetImageId(copy_of(id, copy));
      image.SetName(image.Name() + std::to_string(copy));
      test.scene.images[image.ImageId()] = image;
      test.depths[image.ImageId()] = test.depths.at(id);
      for (int other = 0; other < copy; ++other) {
        test.scene
            .matches[PairIdOfImages(copy_of(id, other), image.ImageId())] =
            identity;
      }
    }
  }
  for (const auto& [pair_id, pair_matches] : matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    for (int copy = 1; copy < 3; ++copy) {
      test.scene.matches[PairIdOfImages(
          copy_of(image_id1, copy), copy_of(image_id2, copy))] = pair_matches;
      test.scene.matches[PairIdOfImages(image_id1, copy_of(image_id2, copy))] =
          pair_matches;
    }
  }
  PairGeometries pairs;
  const DepthGlobalMapperResult result = Map(test, &pairs);
  ASSERT_EQ(result.models.size(), 1);
  EXPECT_EQ(result.models[0]->NumRegImages(), 3 * num_images);
  EXPECT_TRUE(result.warnings.empty());
}

}  // namespace
}  // namespace dgsfm
