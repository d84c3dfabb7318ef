#include "estimators/view_neighbors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Images at x = 0, 1, 2 and 40, and 0.001 beside the first.
const std::vector<Eigen::Vector3d> kCenters = {
    {0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {40, 0, 0}, {0.001, 0, 0}};

TEST(ViewNeighbors, ShareMostPoints) {
  const std::vector<SharedPoint> points = {{{0, 0, 10}, {0, 1, 2}},
                                           {{1, 0, 10}, {0, 2}},
                                           {{2, 0, 10}, {1, 2}},
                                           {{1, 1, 10}, {0, 2}}};
  const auto neighbors = FindNeighbors(kCenters, points, {});
  EXPECT_THAT(neighbors[0], ElementsAre(2, 1));
  EXPECT_THAT(neighbors[2], ElementsAre(0, 1));
  EXPECT_THAT(neighbors[3], IsEmpty());
  ViewNeighborOptions options;
  options.max_num_neighbors = 1;
  EXPECT_THAT(FindNeighbors(kCenters, points, options)[0], ElementsAre(2));
}

TEST(ViewNeighbors, SeePointsFromOtherSides) {
  const std::vector<SharedPoint> points = {{{0, 0, 10}, {0, 1, 3, 4}}};
  const auto neighbors = FindNeighbors(kCenters, points, {});
  // Not from the same place, and not from 76 degrees apart.
  EXPECT_THAT(neighbors[0], ElementsAre(1));
  EXPECT_THAT(neighbors[3], IsEmpty());
}

TEST(ViewNeighbors, OptionsNameTheirBounds) {
  ViewNeighborOptions options;
  std::string error;
  EXPECT_TRUE(options.IsValid(&error));
  options.max_angle_deg = 0.5;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "max_angle_deg must be in [1, 180], but is 0.5");
}

}  // namespace
}  // namespace dgsfm
