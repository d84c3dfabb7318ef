#include "sfm/joining/part_model.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

PartModel CreatePart(size_t num_keypoints,
                     const std::vector<PartModel::Observation>& observations) {
  PartModel part;
  part.images[1].num_keypoints = num_keypoints;
  part.images[1].observations = observations;
  return part;
}

TEST(PartModel, KeepsTheNumbersOfEqualLists) {
  std::vector<PartModel> parts = {
      CreatePart(9, {{2, 0, {5, 6}}, {4, 1, {7, 8}}}),
      CreatePart(9, {{3, 0, {1, 2}}, {4, 1, {7, 8}}})};
  EXPECT_TRUE(UnifyKeypoints(&parts).empty());
  EXPECT_EQ(parts[1].images[1].observations[0].point2D_idx, 3);
  const auto shared = SharedPoints(parts[0].images[1], parts[1].images[1]);
  ASSERT_EQ(shared.size(), 1);
  EXPECT_EQ(shared[0], std::make_pair(1u, 1u));
}

// Dense matches: parts choose key points of their own.
TEST(PartModel, FindsKeypointsByTheirPlaces) {
  std::vector<PartModel> parts = {
      CreatePart(5, {{2, 0, {5, 6}}, {4, 1, {7, 8}}}),
      CreatePart(3, {{0, 7, {7, 8}}, {1, 8, {9, 9}}, {2, 9, {5, 6}}}),
      CreatePart(2, {{0, 4, {9, 9}}, {1, 5, {3, 3}}})};
  const AddedKeypoints added = UnifyKeypoints(&parts);
  ASSERT_EQ(added.at(1).size(), 2);
  EXPECT_EQ(added.at(1)[0], Eigen::Vector2f(9, 9));
  EXPECT_EQ(added.at(1)[1], Eigen::Vector2f(3, 3));
  // In increasing order of their new numbers.
  const auto& second = parts[1].images[1].observations;
  ASSERT_EQ(second.size(), 3);
  EXPECT_EQ(second[0].point2D_idx, 2);
  EXPECT_EQ(second[0].point, 9);
  EXPECT_EQ(second[2].point2D_idx, 5);
  const auto& third = parts[2].images[1].observations;
  EXPECT_EQ(third[0].point2D_idx, 5);
  EXPECT_EQ(third[1].point2D_idx, 6);
}

}  // namespace
}  // namespace dgsfm
