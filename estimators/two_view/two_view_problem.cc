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

double SpreadOf(const std::vector<double>& values) {
  return RobustStddev(values, Median(values));
}

TwoViewData OrderedData(const DepthMatches& matches,
                        const std::vector<int>& order) {
  TwoViewData data;
  data.points1 = matches.points1;
  data.points2 = matches.points2;
  data.depths1 = matches.depths1;
  data.depths2 = matches.depths2;
  for (size_t i = 0; i < data.depths1.size(); ++i) {
    if (!IsKnown(data.depths1[i]) || !IsKnown(data.depths2[i])) {
      data.depths1[i] = data.depths2[i] = 0;
    }
  }
  if (!matches.pixel_jacobians1.empty()) {
    for (const Eigen::Matrix2d& jacobian : matches.pixel_jacobians1) {
      data.covariances1.push_back(UndistortedCovariance(jacobian));
    }
    for (const Eigen::Matrix2d& jacobian : matches.pixel_jacobians2) {
      data.covariances2.push_back(UndistortedCovariance(jacobian));
    }
  }
  return data.Subset(order);
}

}  // namespace

TwoViewProblem::TwoViewProblem(const TwoViewDepthInput& input,
                               const TwoViewDepthOptions& options,
                               SplitMix64* random)
    : options_(options),
      range_(FocalRange::Create(input, options)),
      image_unit1_px_(input.image_size1_px / 2),
      image_unit2_px_(input.image_size2_px / 2),
      min_num_inliers_(input.min_num_inliers),
      order_(RandomOrder(input.matches, options.paper, random)),
      data_(OrderedData(input.matches, order_)),
      scorer_(data_, options.max_epipolar_error_px) {
  for (int i = 0; i < data_.Size(); ++i) {
    num_depth_matches_ += data_.HasDepths(i);
  }
}

TwoViewCostOptions TwoViewProblem::CostOptions(DepthTerm depth_term) const {
  TwoViewCostOptions cost_options;
  cost_options.depth_term = depth_term;
  cost_options.stddev_px = kStddevPerThreshold * options_.max_epipolar_error_px;
  cost_options.max_epipolar_error_px = options_.max_epipolar_error_px;
  cost_options.max_reprojection_error_px = options_.max_reprojection_error_px;
  cost_options.focal_prior1 = range_.prior1;
  cost_options.focal_prior2 = range_.prior2;
  return cost_options;
}

DepthTerm TwoViewProblem::SearchTerm(bool with_depth) const {
  return with_depth ? DepthTerm::WHITENED : DepthTerm::NONE;
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
  const TwoViewCostOptions cost_options = CostOptions(DepthTerm::WHITENED);
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
  const Cheirality is_in_front(model, options_.max_epipolar_error_px);
  std::vector<int> inliers =
      Near(model, options_.max_epipolar_error_px, data_.Size());
  inliers.erase(std::remove_if(inliers.begin(),
                               inliers.end(),
                               [&](int i) {
                                 return !is_in_front(data_.points1[i],
                                                     data_.points2[i]);
                               }),
                inliers.end());
  return inliers;
}

bool TwoViewProblem::DepthsAreEvidence(const TwoViewModel& model) const {
  constexpr double kMaxNoise = 0.25;
  std::vector<double> log_ratios;
  for (const int i : Inliers(model)) {
    Transfer transfer;
    if (!data_.HasDepths(i) || !data_.Forward(model, i, &transfer)) continue;
    log_ratios.push_back(transfer.log_depth_ratio);
  }
  return static_cast<int>(log_ratios.size()) >=
             options_.min_num_depth_matches &&
         SpreadOf(log_ratios) / std::sqrt(2.0) < kMaxNoise;
}

bool TwoViewProblem::AttachScale(TwoViewModel* model) const {
  // Points with a smaller angle between their rays have no depth of their own.
  constexpr double kMinAngleRad = 0.6 * M_PI / 180;
  constexpr double kMaxLogDeviation = 0.5;
  std::vector<double> log_ratios1, log_ratios2;
  for (const int i : Inliers(*model)) {
    if (!data_.HasDepths(i)) continue;
    const auto intersection =
        IntersectRays(*model, data_.points1[i], data_.points2[i]);
    if (!intersection || intersection->angle_rad < kMinAngleRad) continue;
    log_ratios1.push_back(std::log(data_.depths1[i] / intersection->depth1));
    log_ratios2.push_back(std::log(data_.depths2[i] / intersection->depth2));
  }
  if (static_cast<int>(log_ratios1.size()) < options_.min_num_depth_matches) {
    return false;
  }
  const double log_ratio1 = Median(log_ratios1);
  const double log_ratio2 = Median(log_ratios2);
  for (double& value : log_ratios1) value = std::abs(value - log_ratio1);
  for (double& value : log_ratios2) value = std::abs(value - log_ratio2);
  if (Median(log_ratios1) > kMaxLogDeviation ||
      Median(log_ratios2) > kMaxLogDeviation) {
    return false;
  }
  model->translation *= std::exp(log_ratio1);
  model->scale = std::exp(log_ratio1 - log_ratio2);
  return true;
}

}  // namespace dgsfm
