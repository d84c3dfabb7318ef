#include "colmap_ext/database/keypoint_selection.h"

#include "colmap_ext/database/feature_cache.h"
#include "colmap_ext/database/match_reader.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "tests/testing/test_dir.h"

#include <memory>
#include <numeric>
#include <set>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using Indices = std::vector<colmap::point2D_t>;

ImageMatches MatchesOf(const Indices& own) { return {0, own, own}; }

Indices Range(size_t begin, size_t end) {
  Indices indices(end - begin);
  std::iota(indices.begin(), indices.end(), begin);
  return indices;
}

TEST(ChooseKeypoints, TakesThoseThatMostPairsMatchFirst) {
  const std::vector<Eigen::Vector2d> points(10, Eigen::Vector2d(1, 2));
  const Indices chosen = ChooseKeypoints(
      points, {MatchesOf({0, 3, 7}), MatchesOf({1, 7}), MatchesOf({7})}, 3);
  EXPECT_EQ(chosen, Indices{7});
}

TEST(ChooseKeypoints, LeavesWeakPairsWhatTheyHave) {
  const std::vector<Eigen::Vector2d> points(1000, Eigen::Vector2d(1, 2));
  const Indices chosen = ChooseKeypoints(
      points, {MatchesOf(Range(0, 990)), MatchesOf(Range(990, 1000))}, 40);
  EXPECT_EQ(chosen.size(), 40);
  EXPECT_EQ(Indices(chosen.end() - 10, chosen.end()), Range(990, 1000));
}

TEST(ChooseKeypoints, SpreadsOverTheImage) {
  std::vector<Eigen::Vector2d> points;
  // Four in each of 256 parts, those of the first part first.
  for (int i = 0; i < 1024; ++i) {
    points.emplace_back((i / 4) % 16 * 100, (i / 4) / 16 * 80);
  }
  const Indices chosen =
      ChooseKeypoints(points, {MatchesOf(Range(0, 1024))}, 256);
  std::set<std::pair<double, double>> places;
  for (const auto i : chosen) places.emplace(points[i].x(), points[i].y());
  EXPECT_EQ(places.size(), 256);
}

TEST(RestrictMatches, CountsKeptKeypointsAlone) {
  const KeptKeypoints kept = {{1, {2, 5, 9}}};
  colmap::FeatureMatches matches = {{5, 7}, {4, 3}, {2, 1}};
  EXPECT_EQ(RestrictMatches(kept, PairIdOfImages(1, 2), &matches),
            (std::vector<size_t>{0, 2}));
  ASSERT_EQ(matches.size(), 2);
  EXPECT_EQ(matches[0].point2D_idx1, 1);
  EXPECT_EQ(matches[0].point2D_idx2, 7);
  EXPECT_EQ(matches[1].point2D_idx1, 0);
  EXPECT_EQ(RestrictToKept(kept, 1, std::vector<int>(10, 3)).size(), 3);
  EXPECT_EQ(RestrictToKept(kept, 2, std::vector<int>(10, 3)).size(), 10);
}

class SceneWithFewKeypoints : public testing::Test {
 protected:
  void SetUp() override {
    SyntheticSceneOptions options;
    options.num_images = 8;
    options.num_points_per_image = 200;
    options.outlier_match_ratio = 0.2;
    WriteSyntheticDatabase(SynthesizeScene(options), path_);
    all_ = ReadScene(path_);
  }

  const std::string path_ = CreateTestDir() + "/database.db";
  Scene all_;
};

TEST_F(SceneWithFewKeypoints, IsTheWholeSceneWhereThereAreFew) {
  const Scene scene = ReadPartOfScene(path_, 100000, {});
  EXPECT_TRUE(scene.kept_keypoints.empty());
  for (const auto& [image_id, image] : all_.images) {
    EXPECT_EQ(scene.images.at(image_id).NumPoints2D(), image.NumPoints2D());
  }
  ASSERT_EQ(scene.matches.size(), all_.matches.size());
  for (const auto& [pair_id, matches] : all_.matches) {
    EXPECT_EQ(scene.matches.at(pair_id).size(), matches.size());
  }
}

TEST_F(SceneWithFewKeypoints, HasTheSameMatchesReadWhenTheyAreNeeded) {
  for (const int max_num_keypoints : {100000, 60}) {
    const Scene expected = ReadPartOfScene(path_, max_num_keypoints, {});
    Scene scene =
        ReadPartOfScene(path_, max_num_keypoints, {}, SceneContent::PAIRS);
    scene.match_source = std::make_shared<StoredMatches>(path_, scene);
    ASSERT_EQ(scene.matches.size(), expected.matches.size());
    for (const auto& [pair_id, matches] : expected.matches) {
      EXPECT_TRUE(scene.matches.at(pair_id).empty());
      const colmap::FeatureMatches read = MatchesOf(scene, pair_id);
      ASSERT_EQ(read.size(), matches.size());
      for (size_t i = 0; i < read.size(); ++i) {
        EXPECT_EQ(read[i].point2D_idx1, matches[i].point2D_idx1);
        EXPECT_EQ(read[i].point2D_idx2, matches[i].point2D_idx2);
      }
    }
  }
}

TEST_F(SceneWithFewKeypoints, KeepsThePositionsThatMatchesReferTo) {
  constexpr int kMaxNumKeypoints = 60;
  const Scene scene = ReadPartOfScene(path_, kMaxNumKeypoints, {});
  ASSERT_EQ(scene.kept_keypoints.size(), all_.images.size());
  size_t num_keypoints = 0;
  for (const auto& [image_id, kept] : scene.kept_keypoints) {
    ASSERT_EQ(scene.images.at(image_id).NumPoints2D(), kept.size());
    num_keypoints += kept.size();
    for (size_t i = 0; i < kept.size(); ++i) {
      EXPECT_EQ(scene.images.at(image_id).Point2D(i).XY(),
                all_.images.at(image_id).Point2D(kept[i]).XY());
    }
  }
  // A few more than agreed, by the last one that each image chooses.
  EXPECT_LE(num_keypoints, all_.images.size() * (kMaxNumKeypoints + 8));
  ASSERT_EQ(scene.matches.size(), all_.matches.size());
  for (const auto& [pair_id, matches] : scene.matches) {
    colmap::FeatureMatches expected = all_.matches.at(pair_id);
    RestrictMatches(scene.kept_keypoints, pair_id, &expected);
    EXPECT_EQ(matches.size(), expected.size());
    EXPECT_GE(matches.size(), 3);
  }
}

TEST_F(SceneWithFewKeypoints, HasTheListedImagesAlone) {
  std::set<std::string> names;
  for (const colmap::image_t image_id : {1, 3, 4}) {
    names.insert(all_.images.at(image_id).Name());
  }
  const Scene scene = ReadPartOfScene(path_, 60, names);
  EXPECT_EQ(scene.images.size(), 3);
  EXPECT_FALSE(scene.kept_keypoints.empty());
  for (const auto& [image_id, kept] : scene.kept_keypoints) {
    EXPECT_EQ(scene.images.at(image_id).NumPoints2D(), kept.size());
  }
}

TEST_F(SceneWithFewKeypoints, CachedFeaturesAreThoseOfTheDatabase) {
  // Room for one image at a time.
  FeatureCache cache(path_, all_, /*use_depth=*/true, 300);
  for (const colmap::image_t image_id : {1, 2, 1, 1, 3}) {
    const auto features = cache.Get(image_id);
    EXPECT_FALSE(features->depths);
    const colmap::Image& image = all_.images.at(image_id);
    EXPECT_EQ(features->image.ImageId(), image_id);
    EXPECT_EQ(features->image.CameraId(), image.CameraId());
    ASSERT_EQ(features->image.NumPoints2D(), image.NumPoints2D());
    EXPECT_EQ(features->image.Point2D(5).XY(), image.Point2D(5).XY());
  }
}

}  // namespace
}  // namespace dgsfm
