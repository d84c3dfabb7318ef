#include "estimators/two_view/two_view_final.h"

#include "estimators/median.h"
#include "estimators/solvers/epipolar.h"
#include "estimators/two_view/two_view_degeneracy.h"
#include "estimators/two_view/two_view_published.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>

namespace dgsfm {
namespace {

// Focal lengths with a larger standard deviation are no evidence.
constexpr double kMaxLogFocalStddev = 0.3;
// Slowly varying errors of depth do not show in the scatter of the ratios.
constexpr double kMinLogDepthStddev = 0.02;
// A round of refinement.
struct Round {
  // Share of the cost below which a decrease ends it.
  double min_relative_decrease;
  // Enough matches for the accuracy of the round.
  int max_num_matches;
};

// The first estimates the noise. The last goes on until rounding stops it: the
// costs of the outliers hide the last of the decrease.
constexpr Round kRounds[] = {{1e-4, 300}, {1e-13, 1000}};

class Finisher {
 public:
  Finisher(const TwoViewProblem& problem, const TwoViewCandidate& candidate)
      : problem_(problem),
        options_(problem.Options()),
        data_(problem.Data()),
        candidate_(candidate),
        corrected_data_(problem.Data()) {}

  TwoViewCandidate Run(SplitMix64* random, TwoViewDepthResult* result);

 private:
  TwoViewCostOptions EstimateNoise(const TwoViewModel& model, bool with_depth);
  TwoViewData TrustedMatches(const TwoViewModel& model,
                             double max_error_px,
                             int max_num) const;
  void CorrectDepths(const TwoViewCostOptions& cost_options);
  void Refine();
  void Report(TwoViewDepthResult* result) const;
  void ReportDegeneracy(SplitMix64* random, TwoViewDepthResult* result);

  const TwoViewProblem& problem_;
  const TwoViewDepthOptions& options_;
  const TwoViewData& data_;
  TwoViewCandidate candidate_;
  // Without smooth errors.
  double depth_noise_ = 0;
  DepthFields fields_ = DepthFields::Zero();
  // The matches without the smooth errors of their depths.
  TwoViewData corrected_data_;
  // Inliers and covariance of the result.
  std::vector<int> inliers_;
  TwoViewMatrix covariance_ = TwoViewMatrix::Zero();
};

// Noise of points and depths as the inliers of the model show it.
TwoViewCostOptions Finisher::EstimateNoise(const TwoViewModel& model,
                                           bool with_depth) {
  // Exact points have next to no noise: outliers by chance within the threshold
  // are far out of their model.
  constexpr double kMinStddevPerThreshold = 1e-3;
  // Smooth errors of good networks have at least this standard deviation; those
  // of others show in the noise and in the fields found.
  constexpr double kMinFieldStddev = 0.05;
  TwoViewCostOptions cost_options = problem_.CostOptions(with_depth);
  cost_options.loss = TwoViewLoss::TRUNCATED_CAUCHY;
  const double max_error = options_.max_epipolar_error_px;
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  const std::vector<int> inliers = problem_.Inliers(model);
  std::vector<double> errors_px;
  for (const int i : inliers) errors_px.push_back(data_[i].Sampson(F));
  if (!errors_px.empty()) {
    cost_options.stddev_px = std::clamp(RobustStddev(errors_px, 0),
                                        kMinStddevPerThreshold * max_error,
                                        cost_options.stddev_px);
    cost_options.max_epipolar_error_px =
        std::min(kMaxDeviation * cost_options.stddev_px, max_error);
  }
  const std::vector<double> log_ratios =
      with_depth ? LogDepthRatios(corrected_data_, inliers, model)
                 : std::vector<double>();
  if (log_ratios.size() >= kMinNumInliers) {
    depth_noise_ = DepthNoise(log_ratios);
    cost_options.log_depth_stddev =
        std::max(depth_noise_, kMinLogDepthStddev) *
        std::sqrt(std::max(1.0, log_ratios.size() / kNumIndependentDepths));
    cost_options.depth_field_stddev =
        std::max({kMinFieldStddev,
                  depth_noise_,
                  fields_.norm() / std::sqrt(2.0 * kNumDepthFieldTerms)});
  }
  return cost_options;
}

// The matches that may fit the model, without the depths of outliers and those
// that are wrong under the noise of the good ones: the capped noise of the
// refinement would let them pass.
TwoViewData Finisher::TrustedMatches(const TwoViewModel& model,
                                     double max_error_px,
                                     int max_num) const {
  const double max_log_ratio = kMaxDeviation * std::sqrt(2.0) *
                               std::max(depth_noise_, kMinLogDepthStddev);
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  const std::vector<int> near = problem_.Active(model, max_error_px, max_num);
  TwoViewData data = Subset(data_, near);
  for (size_t i = 0; i < data.size(); ++i) {
    Transfer transfer;
    if (!data[i].HasDepths()) continue;
    if (std::abs(data[i].Sampson(F)) > max_error_px ||
        !corrected_data_[near[i]].Forward(model, &transfer) ||
        std::abs(transfer.log_depth_ratio) > max_log_ratio) {
      data[i].depth1 = data[i].depth2 = 0;
    }
  }
  return data;
}

// The next round estimates the noise that the fields leave.
void Finisher::CorrectDepths(const TwoViewCostOptions& cost_options) {
  const auto factor = [this](const Eigen::Vector2d& x, double unit, int begin) {
    return std::exp(-EvaluateDepthFieldBasis(x / unit).dot(
        fields_.segment<kNumDepthFieldTerms>(begin)));
  };
  for (size_t i = 0; i < data_.size(); ++i) {
    const TwoViewMatch& match = data_[i];
    corrected_data_[i].depth1 =
        match.depth1 * factor(match.x1, cost_options.depth_field_unit1_px, 0);
    corrected_data_[i].depth2 =
        match.depth2 * factor(match.x2,
                              cost_options.depth_field_unit2_px,
                              kNumDepthFieldTerms);
  }
}

void Finisher::Refine() {
  const FocalCase focal_case = problem_.Range().focal_case;
  TwoViewModel model = candidate_.model;
  TwoViewCostOptions cost_options;
  TwoViewData data;
  TwoViewRefinementOptions refinement_options;
  for (const Round& round : kRounds) {
    cost_options = EstimateNoise(model, candidate_.with_depth);
    data = TrustedMatches(
        model, cost_options.max_epipolar_error_px, round.max_num_matches);
    refinement_options.min_relative_decrease = round.min_relative_decrease;
    RefineModel(
        data, focal_case, cost_options, refinement_options, &model, &fields_);
    CorrectDepths(cost_options);
  }
  // Without priors, what the matches tell by themselves.
  cost_options.focal_prior1 = cost_options.focal_prior2 = FocalPrior();
  covariance_ =
      EstimateCovariance(data, focal_case, cost_options, model, fields_);
  const TwoViewCandidate refined =
      problem_.Evaluate(model, candidate_.with_depth);
  // Infinite for focal lengths that have left their range.
  if (std::isfinite(refined.cost)) candidate_ = refined;
}

// Whether the translation is zero by its covariance.
bool IsWithinNoise(const Eigen::Vector3d& translation,
                   const TwoViewMatrix& covariance) {
  const Eigen::Matrix3d block = covariance.block<3, 3>(3, 3);
  return translation.dot(block.ldlt().solve(translation)) <
         kMaxDeviation * kMaxDeviation;
}

void Finisher::ReportDegeneracy(SplitMix64* random,
                                TwoViewDepthResult* result) {
  const FocalRange& range = problem_.Range();
  const TwoViewData inliers = Subset(data_, inliers_);
  if (inliers.empty()) return;
  // 98 % of the deviations from a homography by noise alone are below this; a
  // relief of that size still determines something.
  const double max_homography_error_px =
      4 * EstimateNoise(candidate_.model, /*with_depth=*/false).stddev_px;
  const double max_error_px = 2 * options_.max_epipolar_error_px;
  TwoViewDegeneracy& degeneracy = result->degeneracy;
  // A rotation comes with a homography, too, but tells the focal lengths.
  const bool is_rotation =
      IsRotationOnly(inliers, candidate_.model, max_error_px);
  degeneracy.planar =
      !is_rotation && IsPlanar(inliers, max_homography_error_px, random);
  degeneracy.rotation_only =
      result->has_covariance
          ? IsWithinNoise(candidate_.model.translation, covariance_)
          : is_rotation;
  degeneracy.stationary = IsStationary(inliers, max_error_px);
  // Fundamental matrices of a plane come with any epipole, hence with any focal
  // length; smooth errors of the depths do not tell them apart.
  const auto is_identifiable = [&](int param) {
    return !degeneracy.planar &&
           std::sqrt(covariance_(param, param)) < kMaxLogFocalStddev;
  };
  const bool is_known1 = range.view1.is_known;
  const bool is_known2 = range.view2.is_known;
  degeneracy.focal_identifiable1 =
      is_known1 || is_identifiable(kLogFocal1Param);
  degeneracy.focal_identifiable2 =
      is_known2 || is_identifiable(kLogFocal2Param);
  result->estimated_focal1 = !is_known1 && degeneracy.focal_identifiable1;
  result->estimated_focal2 = !is_known2 && degeneracy.focal_identifiable2;
  // All parameters are then off with the focal lengths.
  if (!degeneracy.focal_identifiable1 || !degeneracy.focal_identifiable2) {
    result->has_covariance = false;
    result->covariance.setZero();
  }
}

void Finisher::Report(TwoViewDepthResult* result) const {
  TwoViewModel model = candidate_.model;
  result->num_inliers = static_cast<int>(inliers_.size());

  for (const int i : inliers_) result->inlier_mask[problem_.MatchIdx(i)] = 1;
  result->success = result->num_inliers >= kMinNumInliers;
  if (candidate_.with_depth) {
    result->depth_noise = DepthNoise(LogDepthRatios(data_, inliers_, model));
  }
  result->has_scale = candidate_.with_depth
                          ? candidate_.num_depth_inliers >= kMinNumInliers
                          : problem_.AttachScale(&model);
  if (!result->has_scale) {
    model.scale = 1;
    if (model.translation.norm() > 0) model.translation.normalize();
  }
  result->cam2_from_cam1 = Rigid3d(
      Eigen::Quaterniond(model.rotation).normalized(), model.translation);
  result->scale_1_from_2 = model.scale;
  result->focal_length1_px = model.focal1;
  result->focal_length2_px = model.focal2;
  result->has_covariance =
      candidate_.with_depth && result->has_scale && covariance_.allFinite();
  if (result->has_covariance) result->covariance = covariance_;
}

TwoViewCandidate Finisher::Run(SplitMix64* random, TwoViewDepthResult* result) {
  if (options_.paper) {
    const PublishedRefinement refinement =
        RefinePublishedModel(problem_, candidate_.model);
    candidate_.model = refinement.model;
    covariance_ = refinement.covariance;
    inliers_ = refinement.inliers;
  } else {
    Refine();
    inliers_ = problem_.Inliers(candidate_.model);
  }
  Report(result);
  ReportDegeneracy(random, result);
  return candidate_;
}

}  // namespace

TwoViewCandidate FinishTwoViewModel(const TwoViewProblem& problem,
                                    const TwoViewCandidate& candidate,
                                    SplitMix64* random,
                                    TwoViewDepthResult* result) {
  return Finisher(problem, candidate).Run(random, result);
}

}  // namespace dgsfm
