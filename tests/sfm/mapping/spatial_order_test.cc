#include "sfm/mapping/spatial_order.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

std::vector<Eigen::Vector3d> Plane(int num_positions) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Eigen::Vector3d> positions;
  for (int i = 0; i < num_positions; ++i) {
    positions.emplace_back(uniform(rng), uniform(rng), 0);
  }
  return positions;
}

TEST(SpatialOrder, NeighboursFollowEachOther) {
  std::vector<Eigen::Vector3d> positions = Plane(10000);
  // One that is far off leaves the others in order.
  positions.emplace_back(1e6, 1e6, 1e6);
  const std::vector<size_t> order = OrderAlongCurve(positions);
  ASSERT_EQ(order.size(), positions.size());
  double sum = 0;
  for (size_t i = 0; i + 1 < order.size(); ++i) {
    if (order[i] == 10000 || order[i + 1] == 10000) continue;
    sum += (positions[order[i]] - positions[order[i + 1]]).norm();
  }
  // Cells of the curve that hold one position are 0.01 wide; random neighbours
  // are 0.5 apart.
  EXPECT_LT(sum / 10000, 0.02);
}

TEST(SpatialOrder, EqualPositionsKeepTheirOrder) {
  const std::vector<Eigen::Vector3d> positions(5, Eigen::Vector3d::Ones());
  EXPECT_EQ(OrderAlongCurve(positions), (std::vector<size_t>{0, 1, 2, 3, 4}));
  EXPECT_TRUE(OrderAlongCurve({}).empty());
}

}  // namespace
}  // namespace dgsfm
