#include "sfm/mapping/metric_scale.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

class UnitOfModelTest : public testing::Test {
 protected:
  UnitOfModelTest() {
    SyntheticSceneOptions options;
    options.num_images = 6;
    options.num_points_per_image = 50;
    const SyntheticScene synthetic = SynthesizeScene(options);
    model_ = ReconstructionFromSynthetic(synthetic);
    depths_ = KeypointDepthsFromSynthetic(synthetic);
  }

  // Scales of alternating size.
  MeasuredUnit UnitWithScales(double log_spread, DepthUnit unit) {
    std::map<colmap::image_t, double> scales;
    for (auto& [image_id, depths] : depths_) {
      depths.unit = unit;
      scales[image_id] = std::exp(image_id % 2 == 0 ? log_spread : -log_spread);
    }
    return UnitOfModel(depths_, scales, model_);
  }

  colmap::Reconstruction model_;
  KeypointDepthMap depths_;
};

TEST_F(UnitOfModelTest, IsMetresWhereMetricMapsAgree) {
  const MeasuredUnit agreeing = UnitWithScales(0.1, DepthUnit::METRIC);
  EXPECT_EQ(agreeing.unit, ModelUnit::METRES);
  EXPECT_EQ(agreeing.num_images, 6);
  EXPECT_FALSE(agreeing.IsDoubtful());
  // The factor makes the deviation of normal samples of the median one.
  EXPECT_NEAR(agreeing.log_spread, 1.4826 * 0.1, 1e-4);
  const MeasuredUnit different = UnitWithScales(0.3, DepthUnit::METRIC);
  EXPECT_EQ(different.unit, ModelUnit::DEPTH_MAPS);
  EXPECT_TRUE(different.IsDoubtful());
}

TEST_F(UnitOfModelTest, IsThatOfRelativeMaps) {
  const MeasuredUnit unit = UnitWithScales(0.1, DepthUnit::RELATIVE);
  EXPECT_EQ(unit.unit, ModelUnit::DEPTH_MAPS);
  EXPECT_FALSE(unit.IsDoubtful());
  EXPECT_FALSE(unit.is_metric);
}

TEST_F(UnitOfModelTest, IsThatOfMetricMapsAmongOthers) {
  std::map<colmap::image_t, double> scales;
  for (auto& [image_id, depths] : depths_) {
    const bool is_metric = image_id % 3 == 0;
    depths.unit = is_metric ? DepthUnit::METRIC : DepthUnit::AFFINE_DISPARITY;
    scales[image_id] = is_metric ? 2 : 2e5;
  }
  const MeasuredUnit unit = UnitOfModel(depths_, scales, model_);
  EXPECT_EQ(unit.unit, ModelUnit::METRES);
  EXPECT_TRUE(unit.is_metric);
  EXPECT_EQ(unit.num_images, 2);
  EXPECT_NEAR(unit.log_scale, std::log(2.0), 1e-12);
  EXPECT_NEAR(unit.log_spread, 0, 1e-12);
}

TEST_F(UnitOfModelTest, IsArbitraryWithoutDepth) {
  EXPECT_EQ(UnitOfModel(depths_, {}, model_).unit, ModelUnit::ARBITRARY);
}

}  // namespace
}  // namespace dgsfm
