#include "colmap_ext/depth/affine_depth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;

DepthMap CreateMap(std::vector<float> values) {
  return {
      static_cast<int>(values.size()), 1, DepthUnit::AFFINE_DISPARITY, values};
}

TEST(AffineDepth, DisparityBecomesDepthBeyondItsShift) {
  const AffineDepth affine = {DepthUnit::AFFINE_DISPARITY, 10, -3, 1};
  EXPECT_EQ(ConvertAffine(affine, 2), 2);
  EXPECT_EQ(ConvertAffine(affine, -1), 5);
  EXPECT_EQ(ConvertAffine(affine, -2), 0);  // too near the shift
  EXPECT_EQ(ConvertAffine(affine, -5), 0);
  EXPECT_EQ(ConvertAffine(affine, 0.0f), 0);  // unknown
}

TEST(AffineDepth, DepthLosesItsShift) {
  const AffineDepth affine = {DepthUnit::AFFINE_DEPTH, 2, 1, 0};
  EXPECT_EQ(ConvertAffine(affine, 7), 3);
  EXPECT_EQ(ConvertAffine(affine, 1), 0);
}

TEST(AffineDepth, SamplesBetweenValuesOfAnySign) {
  const DepthMap map = CreateMap({-1, -1.01f, 0, 5, 6});
  // At centres, between centres, next to unknown values and at an edge.
  EXPECT_THAT(
      SampleAffine(
          map, {{0.5, 0.5}, {1, 0.5}, {1.9, 0.5}, {4.1, 0.5}}, 5, 1, true),
      ElementsAre(-1, testing::FloatEq(-1.005f), -1.01f, 6));
  EXPECT_THAT(SampleAffine(map, {{4.1, 0.5}, {9, 0.5}}, 5, 1, false),
              ElementsAre(0, 0));
}

TEST(AffineDepth, StoresValuesOfAnyRange) {
  const DepthMap usual = CreateMap({0, 1, 255});
  EXPECT_EQ(StorableAffine(usual).values, usual.values);
  const DepthMap stored = StorableAffine(CreateMap({-5, 0, 5, 100000}));
  EXPECT_EQ(stored.values[0], 1);
  EXPECT_EQ(stored.values[1], 0);
  EXPECT_GT(stored.values[2], 1);
  EXPECT_EQ(stored.values[3], 32768);
  CompressDepth(stored);  // Throws for what it cannot keep.
}

}  // namespace
}  // namespace dgsfm
