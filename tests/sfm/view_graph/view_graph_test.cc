#include "sfm/view_graph/view_graph.h"

#include "tests/sfm/view_graph/two_triangles.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(ViewGraph, ComponentsAreOrderedBySize) {
  PairGeometries pairs = TwoTriangles();
  EXPECT_EQ(ConnectedImages(pairs).size(), 1);
  pairs[PairIdOfImages(3, 4)].status = PairStatus::ROTATION_OUTLIER;
  const auto components = ConnectedImages(pairs);
  ASSERT_EQ(components.size(), 2);
  EXPECT_EQ(components[0], (std::vector<colmap::image_t>{1, 2, 3, 7}));
  EXPECT_EQ(components[1], (std::vector<colmap::image_t>{4, 5, 6}));
}

TEST(ViewGraph, NoValidPairsGiveNoComponents) {
  PairGeometries pairs;
  pairs[PairIdOfImages(1, 2)] = PairGeometry();
  EXPECT_TRUE(ConnectedImages(pairs).empty());
  EXPECT_TRUE(ConnectedImages({}).empty());
}

TEST(PairGeometry, WithoutItsScaleHasAUnitTranslation) {
  PairGeometry pair;
  pair.has_scale = true;
  pair.scale_1_from_2 = 2.5;
  pair.cam2_from_cam1.translation = Eigen::Vector3d(0, -4, 3);
  pair.DropScale();
  EXPECT_FALSE(pair.has_scale);
  EXPECT_EQ(pair.scale_1_from_2, 1);
  EXPECT_EQ(pair.cam2_from_cam1.translation, Eigen::Vector3d(0, -0.8, 0.6));
  pair.cam2_from_cam1.translation.setZero();
  pair.DropScale();
  EXPECT_EQ(pair.cam2_from_cam1.translation, Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace dgsfm
