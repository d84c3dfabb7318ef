// What changes of the input must not change in the model.

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "estimators/pose_metrics.h"
#include "sfm/global_mapping.h"

#include <algorithm>
#include <map>
#include <string>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct Input {
  Scene scene;
  KeypointDepthMap depths;
};

Input NoisyRing() {
  SyntheticSceneOptions options;
  options.num_images = 12;
  options.num_points_per_image = 200;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.1;
  options.depth_noise.log_scale_stddev = 0.2;
  const SyntheticScene synthetic = SynthesizeScene(options);
  return {SceneFromSynthetic(synthetic),
          KeypointDepthsFromSynthetic(synthetic)};
}

std::unique_ptr<colmap::Reconstruction> Map(Input input, int num_threads) {
  PairVerificationOptions verification;
  verification.num_threads = num_threads;
  DepthGlobalMapperOptions options;
  PairGeometries pairs = VerifyPairs(input.scene, input.depths, verification);
  DepthGlobalMapperResult result = RunGlobalMapping(
      options, verification, PairScores(), &input.scene, &input.depths, &pairs);
  if (result.models.size() != 1) throw std::runtime_error("not one model");
  return std::move(result.models[0]);
}

std::map<std::string, Rigid3d> Poses(const colmap::Reconstruction& model) {
  std::map<std::string, Rigid3d> poses;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    const colmap::Image& image = model.Image(image_id);
    poses[image.Name()] = CamFromWorld(image);
  }
  return poses;
}

// Largest difference of the relative poses of two models of the same images
// [deg], which no gauge changes.
double Difference(const colmap::Reconstruction& expected,
                  const colmap::Reconstruction& model) {
  const PoseMetrics metrics = EvaluatePoses(Poses(expected), Poses(model));
  return *std::max_element(metrics.relative_errors_deg.begin(),
                           metrics.relative_errors_deg.end());
}

// Samples and gauge follow the ids: half a pixel of noise moves poses by about
// 0.05 degrees from seed to seed.
constexpr double kMaxSeedDifferenceDeg = 0.3;

TEST(GlobalMappingProperties, ThreadsDoNotChangeAByte) {
  const auto expected = Map(NoisyRing(), 1);
  for (const int num_threads : {2, 4}) {
    const auto model = Map(NoisyRing(), num_threads);
    ASSERT_EQ(model->RegImageIds(), expected->RegImageIds());
    for (const colmap::image_t image_id : expected->RegImageIds()) {
      EXPECT_EQ(model->Image(image_id).Qvec(),
                expected->Image(image_id).Qvec());
      EXPECT_EQ(model->Image(image_id).Tvec(),
                expected->Image(image_id).Tvec());
    }
    ASSERT_EQ(model->NumPoints3D(), expected->NumPoints3D());
    for (const auto& [point_id, point] : expected->Points3D()) {
      EXPECT_EQ(model->Point3D(point_id).XYZ(), point.XYZ());
    }
  }
}

// New ids in the opposite order, which also swaps the images of all pairs.
Input WithReversedIds(const Input& input) {
  const colmap::image_t sum = input.scene.images.rbegin()->first + 10;
  Input reversed;
  reversed.scene.cameras = input.scene.cameras;
  for (const auto& [image_id, image] : input.scene.images) {
    colmap::Image renamed = image;
    renamed.SetImageId(sum - image_id);
    reversed.scene.images[sum - image_id] = renamed;
  }
  for (const auto& [image_id, depths] : input.depths) {
    reversed.depths[sum - image_id] = depths;
  }
  for (const auto& [pair_id, matches] : input.scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    auto& swapped =
        reversed.scene
            .matches[PairIdOfImages(sum - image_id1, sum - image_id2)];
    for (const colmap::FeatureMatch& match : matches) {
      swapped.emplace_back(match.point2D_idx2, match.point2D_idx1);
    }
  }
  return reversed;
}

TEST(GlobalMappingProperties, IdsDoNotMatter) {
  const Input input = NoisyRing();
  EXPECT_LT(Difference(*Map(input, 2), *Map(WithReversedIds(input), 2)),
            kMaxSeedDifferenceDeg);
}

TEST(GlobalMappingProperties, OrderOfMatchesDoesNotMatter) {
  const Input input = NoisyRing();
  Input permuted = input;
  for (auto& [pair_id, matches] : permuted.scene.matches) {
    std::reverse(matches.begin(), matches.end());
  }
  EXPECT_LT(Difference(*Map(input, 2), *Map(permuted, 2)),
            kMaxSeedDifferenceDeg);
}

TEST(GlobalMappingProperties, ModelScalesWithItsDepth) {
  const Input input = NoisyRing();
  Input scaled = input;
  for (auto& [image_id, depths] : scaled.depths) {
    // A power of two, which leaves the digits alone.
    for (float& depth : depths.depths) depth *= 4;
  }
  const auto expected = Map(input, 2);
  const auto model = Map(scaled, 2);
  const PoseMetrics metrics = EvaluatePoses(Poses(*expected), Poses(*model));
  // Rounding alone differs, but adjustments stop at a relative decrease of
  // 1e-5 of the cost.
  EXPECT_NEAR(metrics.truth_from_model_scale, 0.25, 1e-4);
  EXPECT_LT(Difference(*expected, *model), 1e-2);
}

}  // namespace
}  // namespace dgsfm
