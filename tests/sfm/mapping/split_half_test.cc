#include "sfm/mapping/split_half.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "estimators/median.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

PoseMetrics Repeatability(double image_noise_px) {
  SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::RING);
  options.num_images = 8;
  options.num_points_per_image = 300;
  options.image_noise_px = image_noise_px;
  const SyntheticScene synthetic = SynthesizeScene(options);
  CameraBeliefs beliefs;
  beliefs.given = SceneFromSynthetic(synthetic).cameras;
  const ModelAdjuster adjust = [](const CameraBeliefs& tried,
                                  int max_num_iterations,
                                  colmap::Reconstruction* model) {
    BundleAdjustmentOptions adjustment;
    adjustment.max_num_iterations = max_num_iterations;
    return AdjustBundle(adjustment, 1, 1, tried, model).has_value();
  };
  const auto metrics = SplitHalfRepeatability(
      adjust, 100, beliefs, ReconstructionFromSynthetic(synthetic));
  EXPECT_TRUE(metrics);
  return metrics.value_or(PoseMetrics());
}

TEST(SplitHalfRepeatability, GrowsWithTheNoise) {
  const PoseMetrics exact = Repeatability(1e-6);
  EXPECT_EQ(exact.num_registered, 8);
  EXPECT_EQ(exact.relative_errors_deg.size(), 28);
  // A millionth of a pixel of 700, with some condition.
  EXPECT_LT(exact.median_rotation_error_deg, 1e-5);
  const double error1 = Median(Repeatability(0.25).relative_errors_deg);
  const double error2 = Median(Repeatability(1).relative_errors_deg);
  EXPECT_GT(error1, 0);
  // Four times the noise; medians of eight images' errors are good to half.
  EXPECT_GT(error2, 2 * error1);
}

TEST(SplitHalfRepeatability, NothingIfTheAdjustmentFails) {
  const ModelAdjuster fail =
      [](const CameraBeliefs&, int, colmap::Reconstruction*) { return false; };
  EXPECT_FALSE(SplitHalfRepeatability(fail, 1, {}, colmap::Reconstruction()));
}

}  // namespace
}  // namespace dgsfm
