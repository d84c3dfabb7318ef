#include "sfm/view_graph/missing_matches.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/verification/pair_verification.h"

#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct Verified {
  SyntheticScene synthetic;
  Scene scene;
  PairGeometries pairs;

  ImageIndex Index() const {
    std::vector<colmap::image_t> image_ids;
    for (const auto& [image_id, image] : scene.images) {
      image_ids.push_back(image_id);
    }
    return ImageIndex(image_ids);
  }
};

Verified VerifyFamily(SceneFamily family, bool use_depth) {
  SyntheticSceneOptions options = SceneFamilyOptions(family);
  options.num_images = 24;
  options.num_points_per_image = 400;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.2;
  options.depth_noise = DepthModelFromName("network");
  Verified verified;
  verified.synthetic = SynthesizeScene(options);
  verified.scene = SceneFromSynthetic(verified.synthetic);
  KeypointDepthMap depths;
  if (use_depth) depths = KeypointDepthsFromSynthetic(verified.synthetic);
  PairVerificationOptions verification;
  verification.num_threads = 1;
  verified.pairs = VerifyPairs(verified.scene, depths, verification);
  return verified;
}

TEST(EvidenceOfMissingMatches, SpeaksAgainstLookAlikesSeenFromTheSamePlace) {
  for (const bool use_depth : {true, false}) {
    Verified verified = VerifyFamily(SceneFamily::TWINS, use_depth);
    const ImageIndex index = verified.Index();
    const std::vector<IndexedPair> pairs = ValidPairs(index, &verified.pairs);
    const std::vector<double> evidence =
        EvidenceOfMissingMatches(verified.scene, index, pairs, 1);
    ASSERT_EQ(evidence.size(), pairs.size());
    int num_against_false = 0;
    for (size_t i = 0; i < pairs.size(); ++i) {
      const colmap::image_pair_t pair_id = PairIdOfImages(
          index.IdOf(pairs[i].image1), index.IdOf(pairs[i].image2));
      if (verified.synthetic.pairs.at(pair_id).is_false) {
        num_against_false += evidence[i] > 12;
      } else {
        // One part of the image at most, as something in the way gives.
        EXPECT_LE(evidence[i], 12) << use_depth;
      }
    }
    // Pairs in the middle of the walls show nothing that differs; six to eight
    // images see so much of what lies beside the walls.
    EXPECT_GE(num_against_false, 6) << use_depth;
  }
}

TEST(EvidenceOfMissingMatches, IsNoneWithoutBaseline) {
  Verified verified = VerifyFamily(SceneFamily::TWINS, /*use_depth=*/true);
  for (auto& [pair_id, pair] : verified.pairs) {
    pair.cam2_from_cam1.translation.setZero();
  }
  const ImageIndex index = verified.Index();
  for (const double evidence :
       EvidenceOfMissingMatches(verified.scene,
                                index,
                                ValidPairs(index, &verified.pairs),
                                /*num_threads=*/2)) {
    EXPECT_EQ(evidence, 0);
  }
}

}  // namespace
}  // namespace dgsfm
