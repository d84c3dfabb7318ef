#include "sfm/view_graph/view_graph_preparation.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

double FigureOf(const MappingLog& log, const std::string& name) {
  for (const auto& [figure, value] : log.stages.back().figures) {
    if (figure == name) return value;
  }
  return -1;
}

// A collection of one camera of unknown focal length, without depth.
class AverageFocalsTest : public testing::Test {
 protected:
  AverageFocalsTest() {
    SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::INTERNET);
    options.num_images = 8;
    options.num_points_per_image = 150;
    options.image_noise_px = 0.5;
    options.known_focal_length = false;
    options.camera = {};
    options.camera.num_cameras = 1;
    scene_ = SceneFromSynthetic(SynthesizeScene(options));
    pairs_ = VerifyPairs(scene_, {}, PairVerificationOptions());
  }

  MappingLog Average() {
    MappingLog log;
    AverageFocals({}, {}, {}, &scene_, &pairs_, &log);
    return log;
  }

  Scene scene_;
  PairGeometries pairs_;
};

TEST_F(AverageFocalsTest, PairsAreVerifiedWithAverages) {
  const MappingLog log = Average();
  EXPECT_GT(FigureOf(log, "pairs_verified"), 0);
  // Noise of points and of averages moves some over the bound of an inlier.
  EXPECT_NEAR(FigureOf(log, "share_of_inliers_kept"), 1, 0.05);
}

// Averages that are wrong, as where planes mislead most pairs.
TEST_F(AverageFocalsTest, PairsThatLoseInliersStay) {
  for (auto& [pair_id, pair] : pairs_) {
    pair.focal_length1_px *= 2;
    pair.focal_length2_px *= 2;
    // Those of the averages are not verified again.
    pair.focal_length1_px *= pair_id % 2 == 0 ? 1.02 : 0.98;
  }
  const PairGeometries before = pairs_;
  const MappingLog log = Average();
  EXPECT_EQ(FigureOf(log, "pairs_verified"), 0);
  EXPECT_LT(FigureOf(log, "share_of_inliers_kept"), 0.9);
  for (const auto& [pair_id, pair] : before) {
    EXPECT_EQ(pairs_.at(pair_id).status, pair.status);
    EXPECT_EQ(pairs_.at(pair_id).NumInliers(), pair.NumInliers());
  }
}

}  // namespace
}  // namespace dgsfm
