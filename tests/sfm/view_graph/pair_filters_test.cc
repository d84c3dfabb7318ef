#include "sfm/view_graph/pair_filters.h"

#include "sfm/view_graph/view_graph.h"
#include "tests/sfm/view_graph/two_triangles.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(PairFilters, TripletFilterMaySplitTheGraph) {
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

TEST(PairFilters, PairScoresRemoveOnlyLowScores) {
  PairGeometries pairs = TwoTriangles();
  const PairScores scores = {{PairIdOfImages(4, 3), 0.8},
                             {PairIdOfImages(1, 2), 0.81}};
  EXPECT_EQ(FilterByPairScore({}, scores, &pairs), 1);
  EXPECT_EQ(pairs[PairIdOfImages(3, 4)].status, PairStatus::LOW_PAIR_SCORE);
  EXPECT_EQ(ConnectedImages(pairs).size(), 2);
}

TEST(PairFilters, InvalidOptionsNameFieldAndValue) {
  ViewGraphFilterOptions options;
  options.min_pair_score = 1.5;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_NE(error.find("min_pair_score must be in [0, 1], but is 1.5"),
            std::string::npos)
      << error;
}

}  // namespace
}  // namespace dgsfm
