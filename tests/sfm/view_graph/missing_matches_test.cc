#include "sfm/view_graph/missing_matches.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct Verified {
  SyntheticScene synthetic;
  Scene scene;
  KeypointDepthMap depths;
  PairGeometries pairs;
};

Verified VerifyFamily(SceneFamily family) {
  SyntheticSceneOptions options = SceneFamilyOptions(family);
  options.num_images = 24;
  options.num_points_per_image = 400;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.2;
  options.depth_noise = DepthModelFromName("network");
  Verified verified;
  verified.synthetic = SynthesizeScene(options);
  verified.scene = SceneFromSynthetic(verified.synthetic);
  verified.depths = KeypointDepthsFromSynthetic(verified.synthetic);
  PairVerificationOptions verification;
  verification.num_threads = 1;
  verified.pairs = VerifyPairs(verified.scene, verified.depths, verification);
  return verified;
}

TEST(MissingMatches, SpeakAgainstLookAlikesSeenFromTheSamePlace) {
  const Verified verified = VerifyFamily(SceneFamily::TWINS);
  const MissingMatches missing(verified.scene, verified.depths, verified.pairs);
  int num_against_false = 0;
  for (const auto& [pair_id, pair] : verified.pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const double evidence = missing.EvidenceAgainst(pair_id);
    if (verified.synthetic.pairs.at(pair_id).is_false) {
      num_against_false += evidence > 12;
    } else {
      // One part of the image at most, as something in the way gives.
      EXPECT_LE(evidence, 12);
    }
  }
  // Pairs in the middle of the walls show nothing that differs; six to eight
  // images see so much of what lies beside the walls.
  EXPECT_GE(num_against_false, 6);
}

TEST(MissingMatches, SayNothingWithoutDepth) {
  Verified verified = VerifyFamily(SceneFamily::TWINS);
  verified.depths.clear();
  const MissingMatches missing(verified.scene, verified.depths, verified.pairs);
  for (const auto& [pair_id, pair] : verified.pairs) {
    EXPECT_EQ(missing.EvidenceAgainst(pair_id), 0);
  }
}

}  // namespace
}  // namespace dgsfm
