#include "sfm/georeferencing/pair_positions.h"

#include "estimators/median.h"

#include <cmath>
#include <map>
#include <set>
#include <vector>

namespace dgsfm {

namespace {

// Distances beyond this show the unit of the pairs [standard deviations].
constexpr double kMinDistance = 5;
// Deviations beyond this are not noise [standard deviations].
constexpr double kMaxDistanceError = 4;
// Share of deviating pairs from which the position of an image is wrong.
constexpr double kMaxDeviatingShare = 0.5;
// Share of tested pairs beyond which positions and pairs do not belong
// together.
constexpr double kMaxFilteredShare = 0.3;
constexpr size_t kMinNumPairs = 10;

struct TestedPair {
  colmap::image_t image_id1 = 0;
  colmap::image_t image_id2 = 0;
  PairGeometry* pair = nullptr;
  double distance_m = 0;
  double stddev_m = 0;
  // Whether the distance and the length of the pair differ by more than noise,
  // and whether by a factor as well.
  bool deviates = false;
  bool contradicts = false;
};

std::vector<TestedPair> PairsWithPositions(const PosePriors& priors,
                                           PairGeometries* pairs) {
  std::vector<TestedPair> tested;
  for (auto& [pair_id, pair] : *pairs) {
    if (pair.status != PairStatus::VALID || !pair.has_scale ||
        !(pair.cam2_from_cam1.translation.norm() > 0)) {
      continue;
    }
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto prior1 = priors.find(image_id1);
    const auto prior2 = priors.find(image_id2);
    if (prior1 == priors.end() || prior2 == priors.end() ||
        !prior1->second.HasPosition() || !prior2->second.HasPosition()) {
      continue;
    }
    TestedPair& added = tested.emplace_back();
    added.image_id1 = image_id1;
    added.image_id2 = image_id2;
    added.pair = &pair;
    const Eigen::Vector3d baseline =
        prior2->second.position - prior1->second.position;
    added.distance_m = baseline.norm();
    // The mean over the axes.
    added.stddev_m = std::sqrt(
        (prior1->second.covariance + prior2->second.covariance).trace() / 3);
  }
  return tested;
}

// Logarithm of the unit of the pairs in metres.
std::optional<double> LogUnitOf(const std::vector<TestedPair>& tested) {
  std::vector<double> log_ratios;
  for (const TestedPair& test : tested) {
    if (test.distance_m < kMinDistance * test.stddev_m) continue;
    log_ratios.push_back(std::log(
        test.distance_m / test.pair->cam2_from_cam1.translation.norm()));
  }
  if (log_ratios.size() < kMinNumPairs) return std::nullopt;
  return Median(log_ratios);
}

// The images whose position most of their pairs deviate from, the worst first,
// until there are no more.
std::set<colmap::image_t> WrongPositions(
    const std::vector<TestedPair>& tested) {
  std::set<colmap::image_t> wrong;
  while (true) {
    struct Count {
      size_t num_pairs = 0, num_deviating = 0;
      double Share() const { return double(num_deviating) / double(num_pairs); }
    };
    std::map<colmap::image_t, Count> counts;
    for (const TestedPair& test : tested) {
      if (wrong.count(test.image_id1) > 0 || wrong.count(test.image_id2) > 0) {
        continue;
      }
      for (const colmap::image_t image_id : {test.image_id1, test.image_id2}) {
        ++counts[image_id].num_pairs;
        counts[image_id].num_deviating += test.deviates;
      }
    }
    auto worst = counts.end();
    for (auto it = counts.begin(); it != counts.end(); ++it) {
      if (worst == counts.end() || it->second.Share() > worst->second.Share()) {
        worst = it;
      }
    }
    if (worst == counts.end() || worst->second.Share() < kMaxDeviatingShare) {
      return wrong;
    }
    wrong.insert(worst->first);
  }
}

}  // namespace

PairPositionFilter FilterByPosition(const GeoreferencingOptions& options,
                                    const PosePriors& priors,
                                    PairGeometries* pairs) {
  PairPositionFilter result;
  std::vector<TestedPair> tested = PairsWithPositions(priors, pairs);
  result.num_tested = tested.size();
  const std::optional<double> log_unit = LogUnitOf(tested);
  if (!log_unit) return result;
  const double max_log_ratio = std::log(options.max_pair_distance_ratio);
  for (TestedPair& test : tested) {
    const double length_m =
        test.pair->cam2_from_cam1.translation.norm() * std::exp(*log_unit);
    test.deviates = std::abs(length_m - test.distance_m) >
                    kMaxDistanceError * test.stddev_m;
    test.contradicts =
        test.deviates &&
        std::abs(std::log(test.distance_m / length_m)) > max_log_ratio;
  }
  const std::set<colmap::image_t> wrong = WrongPositions(tested);
  result.num_distrusted = wrong.size();
  std::vector<TestedPair*> leaving;
  size_t num_trusted = 0;
  for (TestedPair& test : tested) {
    if (wrong.count(test.image_id1) > 0 || wrong.count(test.image_id2) > 0) {
      continue;
    }
    ++num_trusted;
    if (test.contradicts) leaving.push_back(&test);
  }
  if (double(leaving.size()) > kMaxFilteredShare * double(num_trusted)) {
    return result;
  }
  for (TestedPair* test : leaving) {
    test->pair->Judge(PairStage::VIEW_GRAPH_FILTER,
                      PairStatus::POSITION_OUTLIER);
  }
  result.num_filtered = leaving.size();
  return result;
}

void JudgePairsByPosition(const GeoreferencingOptions& options,
                          const PosePriors& priors,
                          PairGeometries* pairs,
                          MappingLog* log) {
  if (!options.judge_pairs || !options.use_positions || priors.empty()) return;
  StageTimer timer("pair_positions");
  const PairPositionFilter filter = FilterByPosition(options, priors, pairs);
  timer.Add("pairs_tested", double(filter.num_tested))
      .Add("positions_distrusted", double(filter.num_distrusted))
      .Add("pairs_filtered", double(filter.num_filtered));
  timer.Finish(&log->stages);
}

}  // namespace dgsfm
