#include "colmap_ext/pair_geometry.h"

#include <stdexcept>
#include <utility>

namespace dgsfm {

std::string PairStatusName(PairStatus status) {
  switch (status) {
    case PairStatus::VALID:
      return "valid";
    case PairStatus::TOO_FEW_MATCHES:
      return "too_few_matches";
    case PairStatus::NO_GEOMETRY:
      return "no_geometry";
    case PairStatus::TOO_FEW_INLIERS:
      return "too_few_inliers";
    case PairStatus::LOW_INLIER_RATIO:
      return "low_inlier_ratio";
    case PairStatus::SCALE_OUT_OF_RANGE:
      return "scale_out_of_range";
    case PairStatus::DEPTH_INCONSISTENT:
      return "depth_inconsistent";
    case PairStatus::LOW_PAIR_SCORE:
      return "low_pair_score";
    case PairStatus::LOW_TRIPLET_SUPPORT:
      return "low_triplet_support";
    case PairStatus::ROTATION_OUTLIER:
      return "rotation_outlier";
    case PairStatus::STATIONARY:
      return "stationary";
    case PairStatus::TRANSLATION_OUTLIER:
      return "translation_outlier";
    case PairStatus::MODEL_OUTLIER:
      return "model_outlier";
    case PairStatus::POSITION_OUTLIER:
      return "position_outlier";
  }
  throw std::invalid_argument("unknown pair status " +
                              std::to_string(static_cast<int>(status)));
}

std::string PairStageName(PairStage stage) {
  switch (stage) {
    case PairStage::VERIFICATION:
      return "verification";
    case PairStage::STATIC_BACKGROUND:
      return "static_background";
    case PairStage::DEPTH_RELIABILITY:
      return "depth_reliability";
    case PairStage::VIEW_GRAPH_FILTER:
      return "view_graph_filter";
    case PairStage::REVERIFICATION:
      return "reverification";
    case PairStage::ROTATION_AVERAGING:
      return "rotation_averaging";
    case PairStage::TRANSLATION_AVERAGING:
      return "translation_averaging";
    case PairStage::PAIR_JUDGING:
      return "pair_judging";
  }
  throw std::invalid_argument("unknown stage of pairs " +
                              std::to_string(static_cast<int>(stage)));
}

const std::vector<PairDegeneracy>& PairDegeneracies() {
  static const std::vector<PairDegeneracy> kAll = {
      PairDegeneracy::PLANAR,
      PairDegeneracy::ROTATION_ONLY,
      PairDegeneracy::STATIONARY,
      PairDegeneracy::WEAK_FOCAL1,
      PairDegeneracy::WEAK_FOCAL2};
  return kAll;
}

std::string PairDegeneracyName(PairDegeneracy degeneracy) {
  switch (degeneracy) {
    case PairDegeneracy::PLANAR:
      return "planar";
    case PairDegeneracy::ROTATION_ONLY:
      return "rotation_only";
    case PairDegeneracy::STATIONARY:
      return "stationary";
    case PairDegeneracy::WEAK_FOCAL1:
      return "weak_focal1";
    case PairDegeneracy::WEAK_FOCAL2:
      return "weak_focal2";
  }
  throw std::invalid_argument(
      "unknown pair degeneracy " +
      std::to_string(static_cast<uint32_t>(degeneracy)));
}

void PairTotals::Add(PairStatus status, uint32_t degeneracies, size_t count) {
  num_with_status[status] += count;
  if (status != PairStatus::VALID) return;
  for (const PairDegeneracy degeneracy : PairDegeneracies()) {
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

void PairGeometry::DropScale() {
  has_scale = false;
  scale_1_from_2 = 1;
  cam2_from_cam1.translation.stableNormalize();
  log_scale_stddev = 0;
}

}  // namespace dgsfm
