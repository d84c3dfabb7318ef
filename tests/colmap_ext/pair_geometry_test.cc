#include "colmap_ext/pair_geometry.h"

#include <set>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(PairStatusName, IsUnique) {
  std::set<std::string> names;
  int next = 0;
  for (const auto& [status, name] : kPairStatusNames) {
    EXPECT_EQ(static_cast<int>(status), next++);
    EXPECT_EQ(PairStatusName(status), name);
    names.insert(name);
  }
  EXPECT_EQ(names.size(), size_t(next));
  EXPECT_THROW(PairStatusName(static_cast<PairStatus>(next)),
               std::invalid_argument);
}

TEST(PairStageName, IsUnique) {
  std::set<std::string> names;
  const int last = static_cast<int>(PairStage::PAIR_JUDGING);
  for (int stage = 0; stage <= last; ++stage) {
    names.insert(PairStageName(static_cast<PairStage>(stage)));
  }
  EXPECT_EQ(names.size(), size_t(last) + 1);
  EXPECT_THROW(PairStageName(static_cast<PairStage>(last + 1)),
               std::invalid_argument);
}

TEST(PairTotals, CountsDegeneraciesOfValidPairsOnly) {
  PairGeometry planar;
  planar.Set(PairDegeneracy::PLANAR);
  planar.Set(PairDegeneracy::WEAK_FOCAL2);
  PairTotals totals;
  totals.Add(PairStatus::VALID, planar.degeneracies, 2);
  totals.Add(PairStatus::VALID, 0, 1);
  totals.Add(PairStatus::STATIONARY, planar.degeneracies, 4);
  EXPECT_EQ(totals.num_with_status.at(PairStatus::VALID), 3);
  EXPECT_EQ(totals.num_with_status.at(PairStatus::STATIONARY), 4);
  EXPECT_EQ(totals.num_valid_with_degeneracy.size(), 2);
  EXPECT_EQ(totals.num_valid_with_degeneracy.at(PairDegeneracy::PLANAR), 2);
}

TEST(PairGeometry, KeepsVerdictsThatChangeItsStatus) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.Judge(PairStage::VIEW_GRAPH_FILTER, PairStatus::VALID);
  EXPECT_TRUE(pair.verdicts.empty());
  pair.Judge(PairStage::ROTATION_AVERAGING, PairStatus::ROTATION_OUTLIER);
  pair.Judge(PairStage::PAIR_JUDGING, PairStatus::VALID);
  EXPECT_EQ(pair.status, PairStatus::VALID);
  ASSERT_EQ(pair.verdicts.size(), 3);
  EXPECT_EQ(pair.verdicts[0].stage, PairStage::VERIFICATION);
  EXPECT_EQ(pair.verdicts[0].status, PairStatus::VALID);
  EXPECT_EQ(pair.verdicts[1].stage, PairStage::ROTATION_AVERAGING);
  EXPECT_EQ(pair.verdicts[1].status, PairStatus::ROTATION_OUTLIER);
  EXPECT_EQ(pair.verdicts[2].stage, PairStage::PAIR_JUDGING);
  EXPECT_EQ(pair.verdicts[2].status, PairStatus::VALID);
}

TEST(PairGeometry, KeepsVerdictsWhenReplaced) {
  PairGeometry pair;
  pair.status = PairStatus::DEPTH_INCONSISTENT;
  PairGeometry estimate;
  estimate.status = PairStatus::VALID;
  estimate.num_matches = 7;
  pair.Replace(PairStage::DEPTH_RELIABILITY, estimate);
  EXPECT_EQ(pair.num_matches, 7);
  EXPECT_EQ(pair.status, PairStatus::VALID);
  ASSERT_EQ(pair.verdicts.size(), 2);
  EXPECT_EQ(pair.verdicts[0].status, PairStatus::DEPTH_INCONSISTENT);
  EXPECT_EQ(pair.verdicts[1].stage, PairStage::DEPTH_RELIABILITY);
}

TEST(PairGeometry, DropsItsScale) {
  PairGeometry pair;
  pair.has_scale = true;
  pair.scale_1_from_2 = 2;
  pair.cam2_from_cam1.translation = {0, 3, 4};
  pair.DropScale();
  EXPECT_FALSE(pair.has_scale);
  EXPECT_EQ(pair.scale_1_from_2, 1);
}

}  // namespace
}  // namespace dgsfm
