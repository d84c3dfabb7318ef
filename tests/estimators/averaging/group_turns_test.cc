#include "estimators/averaging/group_turns.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kNumNodes = 16;
constexpr double kMaxErrorRad = 10 * M_PI / 180;

Eigen::Quaterniond TurnAboutZ(double angle_rad) {
  return Eigen::Quaterniond(
      Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ()));
}

// A walk around a house.
std::vector<Eigen::Quaterniond> RingRotations() {
  std::vector<Eigen::Quaterniond> rotations;
  for (int i = 0; i < kNumNodes; ++i) {
    rotations.push_back(TurnAboutZ(2 * M_PI * i / kNumNodes));
  }
  return rotations;
}

JudgedRotation EdgeBetween(const std::vector<Eigen::Quaterniond>& rotations,
                           int node1,
                           int node2) {
  JudgedRotation edge;
  edge.relative.node1 = node1;
  edge.relative.node2 = node2;
  edge.relative.cam2_from_cam1 =
      rotations[node2] * rotations[node1].conjugate();
  edge.cost_if_outlier = 1;
  return edge;
}

// Each node with the next three, and nodes 0 to 4 in front of the house with
// those behind it that look most alike. At the ends of the front something
// differs.
std::vector<JudgedRotation> TwinEdges() {
  std::vector<Eigen::Quaterniond> rotations = RingRotations();
  std::vector<JudgedRotation> edges;
  for (int i = 0; i < kNumNodes; ++i) {
    for (int step = 1; step <= 3; ++step) {
      edges.push_back(EdgeBetween(rotations, i, (i + step) % kNumNodes));
    }
  }
  for (int i = 8; i < 13; ++i) {
    rotations[i] = rotations[i] * TurnAboutZ(M_PI);
  }
  for (int front = 0; front < 5; ++front) {
    for (int back = 8; back < 13; ++back) {
      if (std::abs(back - 8 - front) > 1) continue;
      edges.push_back(EdgeBetween(rotations, front, back));
      const bool differs = front == back - 8 && (front == 0 || front == 4);
      edges.back().cost_if_kept = differs ? 20 : 0;
    }
  }
  return edges;
}

double LargestError(const std::vector<Eigen::Quaterniond>& rotations) {
  const std::vector<Eigen::Quaterniond> truth = RingRotations();
  double largest = 0;
  for (int i = 0; i < kNumNodes; ++i) {
    largest = std::max(largest,
                       rotations[i].angularDistance(rotations[0] * truth[i]));
  }
  return largest;
}

TEST(TurnGroups, UnfoldsTwins) {
  const std::vector<JudgedRotation> edges = TwinEdges();
  std::vector<Eigen::Quaterniond> folded = RingRotations();
  for (int i = 8; i < 13; ++i) folded[i] = folded[i] * TurnAboutZ(M_PI);
  // Twelve edges leave the back, six to each side; two do not fit the fold.
  EXPECT_EQ(CostOfRotations(edges, kMaxErrorRad, folded), 12 + 2 * 20);
  // All false edges are outliers.
  EXPECT_EQ(CostOfRotations(edges, kMaxErrorRad, RingRotations()), 13);
  for (const int fixed_node : {0, 10}) {
    const std::vector<Eigen::Quaterniond> unfolded =
        TurnGroups(edges, kMaxErrorRad, fixed_node, {}, folded);
    // Averages of exact edges: rounding only.
    EXPECT_LT(LargestError(unfolded), 1e-7) << fixed_node;
    EXPECT_LT(unfolded[fixed_node].angularDistance(folded[fixed_node]), 1e-7);
  }
}

// Inliers of look-alikes alone are no reason to fold what agrees otherwise.
TEST(TurnGroups, KeepsWhatCostsLess) {
  const std::vector<Eigen::Quaterniond> truth = RingRotations();
  const std::vector<Eigen::Quaterniond> rotations =
      TurnGroups(TwinEdges(), kMaxErrorRad, /*fixed_node=*/0, {}, truth);
  for (int i = 0; i < kNumNodes; ++i) {
    EXPECT_EQ(rotations[i].coeffs(), truth[i].coeffs());
  }
}

}  // namespace
}  // namespace dgsfm
