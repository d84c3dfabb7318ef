#include "estimators/two_view/two_view_problem.h"

#include "estimators/median.h"
#include "estimators/solvers/epipolar.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace dgsfm {
namespace {

// Matches are trusted to a fraction of the inlier threshold.
constexpr double kStddevPerThreshold = 0.5;

bool IsKnown(double depth) { return depth > 0 && std::isfinite(depth); }

// In a random order the first matches represent all, so that scoring can stop
// early on bad models. The published estimator does not use matches without
// depth.
std::vector<int> RandomOrder(const DepthMatches& matches,
                             bool with_depth_only,
                             SplitMix64* random) {
  std::vector<int> order;
  for (size_t i = 0; i < matches.points1.size(); ++i) {
    if (!with_depth_only ||
        (IsKnown(matches.depths1[i]) && IsKnown(matches.depths2[i]))) {
      order.push_back(static_cast<int>(i));
    }
  }
  Shuffle(random, &order);
  return order;
}

TwoViewData OrderedData(const DepthMatches& matches,
                        const std::vector<int>& order) {
  TwoViewData data;
  for (const int i : order) {
    TwoViewMatch& match = data.emplace_back();
    match.x1 = matches.points1[i];
    match.x2 = matches.points2[i];
    if (IsKnown(matches.depths1[i]) && IsKnown(matches.depths2[i])) {
      match.depth1 = matches.depths1[i];
      match.depth2 = matches.depths2[i];
    }
    if (matches.pixel_jacobians1.empty()) continue;
    match.covariance1 = UndistortedCovariance(matches.pixel_jacobians1[i]);
    match.covariance2 = UndistortedCovariance(matches.pixel_jacobians2[i]);
  }
  return data;
}

}  // namespace

std::vector<double> LogDepthRatios(const TwoViewData& data,
                                   const std::vector<int>& indices,
                                   const TwoViewModel& model) {
  std::vector<double> log_ratios;
  for (const int i : indices) {
    Transfer transfer;
    if (data[i].HasDepths() && data[i].Forward(model, &transfer)) {
      log_ratios.push_back(transfer.log_depth_ratio);
    }
  }
  return log_ratios;
}

double DepthNoise(const std::vector<double>& log_ratios) {
  if (log_ratios.empty()) return 0;
  return RobustStddev(log_ratios, Median(log_ratios)) / std::sqrt(2.0);
}

TwoViewProblem::TwoViewProblem(const TwoViewDepthInput& input,
                               const TwoViewDepthOptions& options,
                               SplitMix64* random)
    : options_(options),
      range_(FocalRange::Create(input, options)),
      image_unit1_px_(input.image_size1_px / 2),
      image_unit2_px_(input.image_size2_px / 2),
      rotation_(input.rotation),
      min_num_inliers_(input.min_num_inliers),
      order_(RandomOrder(input.matches, options.paper, random)),
      data_(OrderedData(input.matches, order_)),
      scorer_(data_, options.max_epipolar_error_px) {
  for (const TwoViewMatch& match : data_) {
    num_depth_matches_ += match.HasDepths();
  }
}

TwoViewCostOptions TwoViewProblem::CostOptions(bool with_depth) const {
  TwoViewCostOptions cost_options;
  cost_options.depth_term = with_depth ? DepthTerm::WHITENED : DepthTerm::NONE;
  cost_options.stddev_px = kStddevPerThreshold * options_.max_epipolar_error_px;
  cost_options.max_epipolar_error_px = options_.max_epipolar_error_px;
  cost_options.max_reprojection_error_px = options_.max_reprojection_error_px;
  cost_options.focal_prior1 = range_.view1.prior;
  cost_options.focal_prior2 = range_.view2.prior;
  cost_options.depth_field_unit1_px = image_unit1_px_;
  cost_options.depth_field_unit2_px = image_unit2_px_;
  return cost_options;
}

// Half of the matches taken for inliers.
double TwoViewProblem::DepthCap() const {
  return std::sqrt(
      std::max(1.0, 0.5 * num_depth_matches_ / kNumIndependentDepths));
}

// Sampson error and cheirality decide what fits; where they cannot tell
// (planes, pure rotation), the depths do. A model without depth pays for all
// of them.
TwoViewCandidate TwoViewProblem::Evaluate(const TwoViewModel& model,
                                          bool with_depth) const {
  TwoViewCandidate candidate;
  candidate.model = model;
  candidate.with_depth = with_depth;
  if (!model.IsFinite() || !range_.Contains(model)) return candidate;
  candidate.score = scorer_.Score(model);
  candidate.cost = candidate.score.cost;
  const TwoViewCostOptions cost_options = CostOptions(/*with_depth=*/true);
  double depth_cost = num_depth_matches_ * cost_options.max_depth_residual *
                      cost_options.max_depth_residual;
  if (with_depth) {
    const TwoViewCost cost =
        TwoViewCostFunction(data_, cost_options).EvaluateDepth(model);
    candidate.num_depth_inliers = cost.num_depth_inliers;
    depth_cost = cost.depth;
  }
  const double weight = cost_options.stddev_px / DepthCap();
  candidate.cost += weight * weight * depth_cost;
  return candidate;
}

std::vector<int> TwoViewProblem::Near(const TwoViewModel& model,
                                      double max_error_px,
                                      int max_num) const {
  return scorer_.Near(model.FundamentalMatrix(), max_error_px, max_num);
}

std::vector<int> TwoViewProblem::Active(const TwoViewModel& model,
                                        double max_error_px,
                                        int max_num) const {
  constexpr double kActiveRange = 2;
  return Near(model, kActiveRange * max_error_px, max_num);
}

std::vector<int> TwoViewProblem::Inliers(const TwoViewModel& model) const {
  return scorer_.Inliers(model, static_cast<int>(data_.size()));
}

bool TwoViewProblem::DepthsAreEvidence(const TwoViewModel& model) const {
  constexpr double kMaxNoise = 0.25;
  const std::vector<double> log_ratios =
      LogDepthRatios(data_, Inliers(model), model);
  return static_cast<int>(log_ratios.size()) >=
             options_.min_num_depth_matches &&
         DepthNoise(log_ratios) < kMaxNoise;
}

bool TwoViewProblem::AttachScale(TwoViewModel* model,
                                 int max_num_matches) const {
  // Points with a smaller angle between their rays have no depth of their own.
  constexpr double kMinAngleRad = 0.6 * M_PI / 180;
  // Larger spreads of the ratios give no scale.
  constexpr double kMaxLogStddev = 0.75;
  std::vector<double> log_ratios1, log_ratios2;
  for (const int i : scorer_.Inliers(*model, max_num_matches)) {
    const TwoViewMatch& match = data_[i];
    if (!match.HasDepths()) continue;
    const auto intersection = IntersectRays(*model, match.x1, match.x2);
    if (!intersection || intersection->angle_rad < kMinAngleRad) continue;
    log_ratios1.push_back(std::log(match.depth1 / intersection->depth1));
    log_ratios2.push_back(std::log(match.depth2 / intersection->depth2));
  }
  if (static_cast<int>(log_ratios1.size()) < options_.min_num_depth_matches) {
    return false;
  }
  const double log_ratio1 = Median(log_ratios1);
  const double log_ratio2 = Median(log_ratios2);
  if (RobustStddev(log_ratios1, log_ratio1) > kMaxLogStddev ||
      RobustStddev(log_ratios2, log_ratio2) > kMaxLogStddev) {
    return false;
  }
  model->translation *= std::exp(log_ratio1);
  model->scale = std::exp(log_ratio1 - log_ratio2);
  return true;
}

}  // namespace dgsfm
