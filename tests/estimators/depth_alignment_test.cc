#include "estimators/depth_alignment.h"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Points of a scene of depths 2 to 10 whose map depths are the true ones times
// exp(-bend(u, v)) / 3 plus noise; every tenth is wrong by a factor of 2 to 3.
std::vector<DepthCorrespondence> CreatePoints(int num_points,
                                              double bend,
                                              double noise) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal(0, noise);
  std::vector<DepthCorrespondence> points;
  for (int i = 0; i < num_points; ++i) {
    DepthCorrespondence point;
    point.u = uniform(random);
    point.v = uniform(random);
    point.point_depth = 2 + 8 * uniform(random);
    const double field = bend * std::sin(5 * point.u) * std::cos(4 * point.v);
    point.map_depth = point.point_depth / 3 * std::exp(-field + normal(random));
    if (i % 10 == 7) point.map_depth *= 2 + uniform(random);
    points.push_back(point);
  }
  return points;
}

DepthAlignmentOptions WithModel(DepthAlignmentModel model) {
  DepthAlignmentOptions options;
  options.model = model;
  return options;
}

TEST(DepthAlignment, FindsScaleAmongOutliers) {
  const auto alignment = AlignDepth(
      CreatePoints(500, 0, 0.01), 1.5, WithModel(DepthAlignmentModel::SCALE));
  ASSERT_TRUE(alignment.has_value());
  EXPECT_EQ(alignment->num_points, 500);
  // A tenth of outliers on one side shifts the median by about 0.14 standard
  // deviations of 1 %.
  EXPECT_NEAR(alignment->scale, 3, 3 * 0.003);
  // The median absolute value of Gaussian noise, somewhat more by outliers.
  EXPECT_NEAR(alignment->residual, 0.0075, 0.0015);
  EXPECT_NEAR(alignment->Apply(0.3, 0.4, 2), 2 * alignment->scale, 1e-12);
}

TEST(DepthAlignment, FindsScaleAndShift) {
  std::vector<DepthCorrespondence> points = CreatePoints(500, 0, 0.001);
  for (DepthCorrespondence& point : points) point.map_depth += 0.5;
  const auto alignment =
      AlignDepth(points, 1, WithModel(DepthAlignmentModel::SCALE_SHIFT));
  ASSERT_TRUE(alignment.has_value());
  // Noise of 0.1 % over 450 points of depths 2 to 10.
  EXPECT_NEAR(alignment->scale, 3, 0.01);
  EXPECT_NEAR(alignment->shift, -1.5, 0.01);
  EXPECT_LT(alignment->residual, 0.002);
  EXPECT_GT(alignment->scale_residual, 0.05);
  // Where the plane says that depth is negative, it is unknown.
  EXPECT_EQ(alignment->Apply(0, 0, 0.1), 0);
}

TEST(DepthAlignment, ShiftNeedsDifferentDepths) {
  std::vector<DepthCorrespondence> points(20);
  for (DepthCorrespondence& point : points) {
    point.map_depth = 2;
    point.point_depth = 6;
  }
  const auto alignment =
      AlignDepth(points, 1, WithModel(DepthAlignmentModel::SCALE_SHIFT));
  ASSERT_TRUE(alignment.has_value());
  EXPECT_NEAR(alignment->scale, 3, 1e-12);
  EXPECT_EQ(alignment->shift, 0);
}

TEST(DepthAlignment, FieldFollowsSmoothErrors) {
  const auto alignment =
      AlignDepth(CreatePoints(2000, 0.1, 0.01), 1.5, DepthAlignmentOptions());
  ASSERT_TRUE(alignment.has_value());
  EXPECT_EQ(alignment->num_cols, 12);
  EXPECT_EQ(alignment->num_rows, 8);
  // Noise of 1 % has the median 0.7 %; the field is to add little.
  EXPECT_LT(alignment->residual, 0.009);
  EXPECT_GT(alignment->scale_residual, 0.03);
  for (double u = 0.05; u < 1; u += 0.1) {
    for (double v = 0.05; v < 1; v += 0.1) {
      const double truth =
          3 * std::exp(0.1 * std::sin(5 * u) * std::cos(4 * v));
      // About 20 points per node.
      EXPECT_NEAR(alignment->Apply(u, v, 1) / truth, 1, 0.02);
    }
  }
}

TEST(DepthAlignment, FieldIsConstantWhereOnlyNoiseIsLeft) {
  const auto alignment =
      AlignDepth(CreatePoints(60, 0, 0.05), 1, DepthAlignmentOptions());
  ASSERT_TRUE(alignment.has_value());
  for (const double u : {0.0, 0.5, 1.0}) {
    for (const double v : {0.0, 0.5, 1.0}) {
      // 60 points of 5 % know a nearly linear field to about 3 % at its ends.
      EXPECT_NEAR(alignment->Apply(u, v, 1), 3, 3 * 0.06);
    }
  }
}

TEST(DepthAlignment, NeedsPoints) {
  EXPECT_FALSE(AlignDepth(CreatePoints(9, 0, 0), 1, DepthAlignmentOptions())
                   .has_value());
  EXPECT_TRUE(AlignDepth(CreatePoints(10, 0, 0), 1, DepthAlignmentOptions())
                  .has_value());
  std::vector<DepthCorrespondence> points = CreatePoints(20, 0, 0);
  points[3].map_depth = 0;
  EXPECT_THROW(AlignDepth(points, 1, DepthAlignmentOptions()),
               std::invalid_argument);
}

TEST(DepthAlignment, CorrectionsAreAppended) {
  DepthAlignment alignment;
  alignment.scale = 2;
  alignment.shift = 1;
  DepthAlignment correction;
  correction.scale = 0.5;
  correction.num_cols = 2;
  correction.num_rows = 2;
  correction.field = {0, 0.1, 0.2, 0.3};
  DepthAlignment both = alignment;
  for (int i = 0; i < 2; ++i) {
    both.Append(correction);
    const double depth = alignment.Apply(0.3, 0.6, 4);
    EXPECT_NEAR(
        both.Apply(0.3, 0.6, 4),
        correction.Apply(
            0.3, 0.6, i == 0 ? depth : correction.Apply(0.3, 0.6, depth)),
        1e-12);
  }
  correction.num_cols = 1;
  EXPECT_THROW(both.Append(correction), std::invalid_argument);

  DepthMap map = {2, 1, DepthUnit::METRIC, {4, 0}};
  alignment.Apply(&map);
  EXPECT_EQ(map.values, std::vector<float>({9, 0}));
}

TEST(DepthAlignment, OptionsNameTheirBounds) {
  DepthAlignmentOptions options;
  std::string error;
  EXPECT_TRUE(options.IsValid(&error));
  options.min_num_points = 4;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "min_num_points must be >= 5, but is 4");
  options = {};
  options.num_nodes = 65;
  EXPECT_FALSE(options.IsValid(&error));
}

}  // namespace
}  // namespace dgsfm
