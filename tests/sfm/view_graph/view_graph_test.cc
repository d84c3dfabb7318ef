#include "sfm/view_graph/view_graph.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

PairGeometry ValidPair(size_t num_inliers) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.inlier_matches.resize(num_inliers);
  pair.depth_verified.resize(num_inliers, 1);
  return pair;
}

// Two triangles, images 1 2 3 and 4 5 6, linked by the pair (3, 4), and image
// 7 linked to 1 and 2 by weak pairs.
PairGeometries TwoTriangles() {
  PairGeometries pairs;
  for (const auto& [id1, id2] :
       std::vector<std::pair<colmap::image_t, colmap::image_t>>{
           {1, 2}, {2, 3}, {1, 3}, {4, 5}, {5, 6}, {4, 6}}) {
    pairs[PairIdOfImages(id1, id2)] = ValidPair(100);
  }
  pairs[PairIdOfImages(3, 4)] = ValidPair(20);
  pairs[PairIdOfImages(1, 7)] = ValidPair(30);
  pairs[PairIdOfImages(2, 7)] = ValidPair(20);
  return pairs;
}

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

TEST(ViewGraph, TripletFilterMaySplitTheGraph) {
  PairGeometries pairs = TwoTriangles();
  ViewGraphFilterOptions options;
  options.min_triplet_support = 0.6;
  // The pairs of image 7 have supports 0.3 and 0.2.
  EXPECT_EQ(FilterByTripletSupport(options, &pairs), 2);
  EXPECT_EQ(pairs[PairIdOfImages(2, 7)].status,
            PairStatus::LOW_TRIPLET_SUPPORT);
  // Its images are in no triplet.
  EXPECT_EQ(pairs[PairIdOfImages(3, 4)].status, PairStatus::VALID);
  EXPECT_EQ(ConnectedImages(pairs)[0].size(), 6);
}

TEST(ViewGraph, PairScoresRemoveOnlyLowScores) {
  PairGeometries pairs = TwoTriangles();
  const PairScores scores = {{PairIdOfImages(4, 3), 0.8},
                             {PairIdOfImages(1, 2), 0.81}};
  EXPECT_EQ(FilterByPairScore(scores, ViewGraphFilterOptions(), &pairs), 1);
  EXPECT_EQ(pairs[PairIdOfImages(3, 4)].status, PairStatus::LOW_PAIR_SCORE);
  EXPECT_EQ(ConnectedImages(pairs).size(), 2);
}

TEST(ViewGraph, InvalidOptionsNameFieldAndValue) {
  ViewGraphFilterOptions options;
  options.min_pair_score = 1.5;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_NE(error.find("min_pair_score must be in [0, 1], but is 1.5"),
            std::string::npos)
      << error;
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
