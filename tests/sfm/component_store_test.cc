#include "sfm/component_store.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

PairGeometry CreatePair(size_t num_inliers) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.num_matches = 20;
  pair.inlier_matches.resize(num_inliers);
  pair.depth_verified.resize(num_inliers);
  return pair;
}

TEST(ApplyOutcomes, PairsAreAsMappingLeftThem) {
  PairGeometries before;
  before[PairIdOfImages(1, 2)] = CreatePair(9);
  before[PairIdOfImages(1, 3)] = CreatePair(8);
  before[PairIdOfImages(1, 3)].status = PairStatus::NO_GEOMETRY;
  before[PairIdOfImages(2, 3)] = CreatePair(7);
  before[PairIdOfImages(3, 4)] = CreatePair(6);

  PairGeometries mapped = before;
  PairGeometry& filtered = mapped.at(PairIdOfImages(1, 2));
  filtered.Judge(PairStage::ROTATION_AVERAGING, PairStatus::ROTATION_OUTLIER);
  filtered.ReleaseInliers();
  PairGeometry& recovered = mapped.at(PairIdOfImages(1, 3));
  PairGeometry found = CreatePair(15);
  found.Set(PairDegeneracy::PLANAR);
  recovered.Replace(PairStage::ROTATION_RECOVERY, found);
  recovered.ReleaseInliers();

  const auto outcomes = OutcomesOf({1, 2, 3}, mapped);
  EXPECT_EQ(outcomes.size(), 3);
  PairGeometries restored = before;
  ApplyOutcomes(outcomes, &restored);
  for (const auto& [pair_id, pair] : mapped) {
    const PairGeometry& other = restored.at(pair_id);
    EXPECT_EQ(other.status, pair.status);
    EXPECT_EQ(other.verdicts.size(), pair.verdicts.size());
    EXPECT_EQ(other.degeneracies, pair.degeneracies);
    EXPECT_EQ(other.num_matches, pair.num_matches);
    EXPECT_EQ(other.NumInliers(), pair.NumInliers());
    EXPECT_EQ(other.inlier_matches.size(), pair.inlier_matches.size());
  }
}

}  // namespace
}  // namespace dgsfm
