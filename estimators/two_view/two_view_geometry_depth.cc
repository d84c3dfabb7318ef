#include "estimators/two_view/two_view_geometry_depth.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/option_check.h"
#include "estimators/random.h"
#include "estimators/two_view/two_view_final.h"
#include "estimators/two_view/two_view_problem.h"
#include "estimators/two_view/two_view_published.h"
#include "estimators/two_view/two_view_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/LU>

namespace dgsfm {
namespace {

// One per match, or none.
void CheckJacobians(const std::vector<Eigen::Matrix2d>& jacobians,
                    size_t num_matches) {
  DGSFM_CHECK(jacobians.empty() || jacobians.size() == num_matches)
      << jacobians.size() << " Jacobians for " << num_matches << " matches";
  for (const Eigen::Matrix2d& jacobian : jacobians) {
    DGSFM_CHECK(jacobian.allFinite() && jacobian.determinant() != 0)
        << jacobian;
  }
}

void CheckInput(const TwoViewDepthInput& input,
                const TwoViewDepthOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(std::isfinite(options.max_epipolar_error_px) &&
              std::isfinite(options.max_reprojection_error_px))
      << "thresholds must be finite";
  const DepthMatches& matches = input.matches;
  const size_t size = matches.points1.size();
  DGSFM_CHECK(matches.points2.size() == size &&
              matches.depths1.size() == size && matches.depths2.size() == size)
      << "arrays of " << size << ", " << matches.points2.size() << ", "
      << matches.depths1.size() << " and " << matches.depths2.size()
      << " elements";
  CheckJacobians(matches.pixel_jacobians1, size);
  CheckJacobians(matches.pixel_jacobians2, size);
  DGSFM_CHECK(matches.pixel_jacobians1.size() ==
              matches.pixel_jacobians2.size());
  for (size_t i = 0; i < size; ++i) {
    DGSFM_CHECK(matches.points1[i].allFinite() &&
                matches.points2[i].allFinite())
        << "match " << i;
  }
  for (const FocalPrior& prior : {input.focal_prior1, input.focal_prior2}) {
    DGSFM_CHECK(prior.log_stddev >= 0 && std::isfinite(prior.log_stddev))
        << "log_stddev = " << prior.log_stddev;
    DGSFM_CHECK(!prior.Exists() ||
                (prior.focal_px > 0 && std::isfinite(prior.focal_px)))
        << "focal_px = " << prior.focal_px;
  }
  for (const double value : {input.focal_length1_px,
                             input.focal_length2_px,
                             input.image_size1_px,
                             input.image_size2_px}) {
    DGSFM_CHECK(value > 0 && std::isfinite(value)) << "value = " << value;
  }
}

// Variance of the Sampson errors of inliers [px^2].
double SampsonVariance(const TwoViewProblem& problem,
                       const TwoViewScore& score) {
  const double max_error_px = problem.Options().max_epipolar_error_px;
  const double num_outliers =
      static_cast<double>(problem.Data().size()) - score.num_inliers;
  return (score.cost - num_outliers * max_error_px * max_error_px) /
         std::max(score.num_inliers, 1);
}

// How much less than a model with depth, by Sampson errors, the one without has
// to cost [px^2]: it has more freedom to fit outliers. If it agrees with the
// depths, too, their smooth errors decide no more than the noise of the points
// leaves open; but depths of little noise, and those of degenerate pairs, are
// right about what matches hardly determine.
double MinGain(const TwoViewProblem& problem,
               const TwoViewScore& score_with_depth,
               const TwoViewDepthResult& result_with_depth,
               TwoViewModel alternative) {
  constexpr double kMaxTrustedDepthNoise = 0.03;
  const TwoViewDegeneracy& degeneracy = result_with_depth.degeneracy;
  const FocalCase focal_case = problem.Range().focal_case;
  const double max_error_px = problem.Options().max_epipolar_error_px;
  const double min_gain =
      problem.Options().min_num_depth_matches * max_error_px * max_error_px;
  // Two or one-sided focal lengths are the ones that depths determine best.
  const bool points_decide =
      (focal_case == FocalCase::KNOWN || focal_case == FocalCase::SHARED) &&
      result_with_depth.depth_noise > kMaxTrustedDepthNoise &&
      !degeneracy.planar && !degeneracy.rotation_only &&
      problem.AttachScale(&alternative) &&
      problem.DepthsAreEvidence(alternative);
  if (!points_decide) return min_gain;
  return std::min(min_gain,
                  kMaxDeviation * kMaxDeviation *
                      SampsonVariance(problem, score_with_depth));
}

// The candidate with depth, unless the depths are no evidence or contradict the
// points. The result comes with a mask of zeros.
void Finish(const TwoViewProblem& problem,
            const TwoViewSearchResult& found,
            SplitMix64* random,
            TwoViewDepthResult* result) {
  TwoViewDepthResult alternative = *result;
  const bool has_depth = std::isfinite(found.with_depth.cost);
  const bool has_alternative = std::isfinite(found.without_depth.cost);
  double max_cost = std::numeric_limits<double>::infinity();
  if (has_depth &&
      (!has_alternative || problem.DepthsAreEvidence(found.with_depth.model))) {
    const TwoViewScore score =
        FinishTwoViewModel(problem, found.with_depth, random, result).score;
    max_cost = score.cost -
               MinGain(problem, score, *result, found.without_depth.model);
  }
  if (!has_alternative || found.without_depth.score.cost > max_cost) return;
  if (FinishTwoViewModel(problem, found.without_depth, random, &alternative)
          .score.cost < max_cost) {
    *result = alternative;
  }
}

}  // namespace

bool TwoViewDepthOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Above("TwoViewDepth.max_epipolar_error", max_epipolar_error_px, 0)
      .Above(
          "TwoViewDepth.max_reprojection_error", max_reprojection_error_px, 0)
      .AtLeast("min_num_trials", min_num_trials, 1)
      .AtLeast("max_num_trials", max_num_trials, min_num_trials)
      .Within("confidence", confidence, 0, 1)
      .Above("min_focal_length_ratio", min_focal_length_ratio, 0)
      .Above("max_focal_length_ratio",
             max_focal_length_ratio,
             min_focal_length_ratio)
      .AtLeast("min_num_depth_matches", min_num_depth_matches, 3)
      .AreKept();
}

TwoViewDepthResult EstimateTwoViewGeometryWithDepth(
    const TwoViewDepthInput& input, const TwoViewDepthOptions& options) {
  CheckInput(input, options);
  // One stream for order and samples makes the pair independent of others.
  SplitMix64 random(input.seed);
  const TwoViewProblem problem(input, options, &random);
  TwoViewDepthResult result;
  result.inlier_mask.assign(input.matches.points1.size(), 0);
  result.focal_length1_px = problem.Range().view1.guess_px;
  result.focal_length2_px = problem.Range().view2.guess_px;
  const TwoViewSearchResult found = options.paper
                                        ? SearchPublishedModel(problem, &random)
                                        : SearchTwoViewModel(problem, &random);
  Finish(problem, found, &random, &result);
  result.num_trials = found.num_trials;
  return result;
}

}  // namespace dgsfm
