#include "sfm/mapping/component_mapping.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Two places that were photographed with one camera.
struct TwoPlaces {
  Scene scene;
  KeypointDepthMap depths;
  PairGeometries pairs;
};

TwoPlaces CreateTwoPlaces() {
  SyntheticSceneOptions options;
  options.num_images = 16;
  options.num_points_per_image = 200;
  options.num_components = 2;
  options.image_noise_px = 0.5;
  options.known_focal_length = false;
  options.camera.num_cameras = 1;
  const SyntheticScene synthetic = SynthesizeScene(options);
  TwoPlaces places;
  places.scene = SceneFromSynthetic(synthetic);
  places.depths = KeypointDepthsFromSynthetic(synthetic);
  places.pairs =
      VerifyPairs(places.scene, places.depths, PairVerificationOptions());
  return places;
}

struct Mapped {
  std::vector<ComponentResult> results;
  PairGeometries pairs;
};

Mapped MapInOrder(const TwoPlaces& places, const std::vector<int>& order) {
  DepthGlobalMapperOptions options;
  PairVerificationOptions verification;
  verification.num_threads = 1;
  const CameraBeliefs beliefs = GivenBeliefs(places.scene);
  const FrameMembers frames;
  const MappingContext context = {
      options, verification, places.scene, places.depths, frames, beliefs};
  Mapped mapped;
  mapped.pairs = places.pairs;
  const auto components = ConnectedImages(mapped.pairs);
  mapped.results.resize(components.size());
  for (const int i : order) {
    const auto rotations = AverageComponentRotations(options.averaging,
                                                     places.scene,
                                                     frames,
                                                     components.at(i),
                                                     /*num_threads=*/1,
                                                     &mapped.pairs);
    MappingLog log;
    mapped.results[i] =
        MapComponent(context, *rotations, false, &mapped.pairs, &log);
  }
  return mapped;
}

TEST(MapComponent, DoesNotDependOnOtherComponents) {
  const TwoPlaces places = CreateTwoPlaces();
  const Mapped forward = MapInOrder(places, {0, 1});
  const Mapped backward = MapInOrder(places, {1, 0});
  for (int i = 0; i < 2; ++i) {
    const ComponentResult& result1 = forward.results[i];
    const ComponentResult& result2 = backward.results[i];
    ASSERT_TRUE(result1.model && result2.model);
    EXPECT_EQ(result1.model->NumRegImages(), 8);
    EXPECT_EQ(result1.depth_scales, result2.depth_scales);
    for (const colmap::image_t image_id : result1.model->RegImageIds()) {
      const colmap::Image& image1 = result1.model->Image(image_id);
      const colmap::Image& image2 = result2.model->Image(image_id);
      EXPECT_EQ(CamFromWorld(image1).translation,
                CamFromWorld(image2).translation);
      EXPECT_EQ(image1.CameraId(), image2.CameraId());
      EXPECT_EQ(result1.model->Camera(image1.CameraId()).Params(),
                result2.model->Camera(image2.CameraId()).Params());
    }
  }
  for (const auto& [pair_id, pair] : forward.pairs) {
    EXPECT_EQ(pair.status, backward.pairs.at(pair_id).status);
  }
}

}  // namespace
}  // namespace dgsfm
