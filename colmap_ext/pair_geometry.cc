#include "colmap_ext/pair_geometry.h"

#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

using StageName = std::pair<PairStage, const char*>;
constexpr StageName kStageNames[] = {
    {PairStage::VERIFICATION, "verification"},
    {PairStage::STATIC_BACKGROUND, "static_background"},
    {PairStage::DEPTH_RELIABILITY, "depth_reliability"},
    {PairStage::VIEW_GRAPH_FILTER, "view_graph_filter"},
    {PairStage::REVERIFICATION, "reverification"},
    {PairStage::ROTATION_AVERAGING, "rotation_averaging"},
    {PairStage::ROTATION_RECOVERY, "rotation_recovery"},
    {PairStage::TRANSLATION_AVERAGING, "translation_averaging"},
    {PairStage::PAIR_JUDGING, "pair_judging"}};

using DegeneracyName = std::pair<PairDegeneracy, const char*>;
constexpr DegeneracyName kDegeneracyNames[] = {
    {PairDegeneracy::PLANAR, "planar"},
    {PairDegeneracy::ROTATION_ONLY, "rotation_only"},
    {PairDegeneracy::STATIONARY, "stationary"},
    {PairDegeneracy::WEAK_FOCAL1, "weak_focal1"},
    {PairDegeneracy::WEAK_FOCAL2, "weak_focal2"}};

// Numbers of databases are converted to enumerations unchecked: any may come.
template <typename Names, typename Value>
std::string NameOf(const Names& names, Value value, const std::string& what) {
  for (const auto& [named_value, name] : names) {
    if (named_value == value) return name;
  }
  throw std::invalid_argument("unknown " + what + " " +
                              std::to_string(static_cast<int>(value)));
}

}  // namespace

std::string PairStatusName(PairStatus status) {
  return NameOf(kPairStatusNames, status, "pair status");
}

bool StaysOut(PairStatus status) {
  return status == PairStatus::LOW_PAIR_SCORE ||
         status == PairStatus::POSITION_OUTLIER;
}

std::string PairStageName(PairStage stage) {
  return NameOf(kStageNames, stage, "stage of pairs");
}

const std::vector<PairDegeneracy>& PairDegeneracies() {
  static const std::vector<PairDegeneracy> kAll = [] {
    std::vector<PairDegeneracy> all;
    for (const auto& [value, name] : kDegeneracyNames) all.push_back(value);
    return all;
  }();
  return kAll;
}

std::string PairDegeneracyName(PairDegeneracy degeneracy) {
  return NameOf(kDegeneracyNames, degeneracy, "pair degeneracy");
}

void PairTotals::Add(PairStatus status, uint32_t degeneracies, size_t count) {
  num_with_status[status] += count;
  if (status != PairStatus::VALID) return;
  for (const auto& [degeneracy, name] : kDegeneracyNames) {
    if (degeneracies & static_cast<uint32_t>(degeneracy)) {
      num_valid_with_degeneracy[degeneracy] += count;
    }
  }
}

void PairGeometry::Judge(PairStage stage, PairStatus verdict) {
  if (verdict == status) return;
  if (verdicts.empty()) verdicts.push_back({PairStage::VERIFICATION, status});
  verdicts.push_back({stage, verdict});
  status = verdict;
}

void PairGeometry::Replace(PairStage stage, PairGeometry estimate) {
  const PairStatus new_status = estimate.status;
  estimate.status = status;
  estimate.verdicts = std::move(verdicts);
  *this = std::move(estimate);
  Judge(stage, new_status);
}

void PairGeometry::ReleaseInliers() {
  num_released_inliers = NumInliers();
  inlier_matches = {};
  depth_verified = {};
}

void PairGeometry::DropScale() {
  has_scale = false;
  scale_1_from_2 = 1;
  cam2_from_cam1.translation.stableNormalize();
  log_scale_stddev = 0;
}

}  // namespace dgsfm
