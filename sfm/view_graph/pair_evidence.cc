#include "sfm/view_graph/pair_evidence.h"

#include <cmath>

namespace dgsfm {

namespace {

// Log odds of the logistic model and what each quantity adds to them.
constexpr double kLogOdds = 1.3;
constexpr double kPerLogNumInliers = 0.5;  // against kNumInliers
constexpr double kNumInliers = 50;
constexpr double kPerLogInlierOdds = 1.0;
constexpr double kWithScale = 1.3;
// One inlier more and one outlier more than there are: odds are never 0.
constexpr double kNumPseudoMatches = 1;

double LogOdds(const PairGeometry& pair) {
  const double num_inliers = double(pair.NumInliers()) + kNumPseudoMatches;
  const double num_outliers =
      double(pair.num_matches - pair.NumInliers()) + kNumPseudoMatches;
  return kLogOdds + kPerLogNumInliers * std::log(num_inliers / kNumInliers) +
         kPerLogInlierOdds * std::log(num_inliers / num_outliers) +
         (pair.has_scale ? kWithScale : 0.0);
}

}  // namespace

double PairProbability(const PairGeometry& pair) {
  return 1 / (1 + std::exp(-LogOdds(pair)));
}

double PairEvidence(const PairGeometry& pair) {
  return std::log1p(std::exp(LogOdds(pair)));
}

}  // namespace dgsfm
