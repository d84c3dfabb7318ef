#include "estimators/two_view_geometry_depth.h"

#include "colmap_ext/check.h"
#include "estimators/random.h"
#include "estimators/solvers/epipolar.h"
#include "estimators/two_view_cost.h"
#include "estimators/two_view_hypotheses.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Cholesky>

namespace dgsfm {
namespace {

// Smallest support that tells a model from a coincidence of its own sample.
constexpr int kMinNumInliers = 8;
// Matches are trusted to a fraction of the inlier threshold.
constexpr double kStddevPerThreshold = 0.5;
// Depth errors of a network vary slowly over an image: a pair has no more than
// about this many independent ones, however many matches there are.
constexpr double kNumIndependentDepths = 20;
// Log-normal prior around guessed focal lengths: a factor of 1.6.
constexpr double kLogFocalPriorStddev = 0.5;
// Focal lengths known better than this need no prior, ...
constexpr double kMaxPriorFreeLogFocalStddev = 0.1;
// ... and worse than this they are no evidence.
constexpr double kMaxLogFocalStddev = 0.3;
// Scale attached to a model without depth: so many triangulated points, with
// at least this angle between their rays, whose depth ratios agree.
constexpr int kMinNumScalePoints = 15;
constexpr double kMinScaleAngleRad = 0.6 * M_PI / 180;
constexpr double kMaxScaleDeviation = 0.5;

// Refinement of the winner goes on until rounding stops it: the costs of the
// outliers hide the last of the decrease.
constexpr double kMinFinalDecrease = 1e-13;

double Median(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Of a Gaussian, from the median absolute deviation about `center`.
double RobustStddev(std::vector<double> values, double center) {
  for (double& value : values) value = std::abs(value - center);
  return 1.4826 * Median(std::move(values));
}

// A stage of local optimisation.
struct Round {
  // Factor of the thresholds.
  double widening;
  int max_num_iterations;
  // Enough matches for the accuracy of the stage.
  int max_num_matches;
  // Whether the depths count as no more than kNumIndependentDepths.
  bool capped;
};

// Minimal models of noisy depths are off by much more than the inlier
// threshold: a wide basin first brings them in.
constexpr Round kDepthRounds[] = {{16, 3, 200, false},
                                  {8, 3, 200, false},
                                  {4, 3, 400, true},
                                  {2, 4, 800, true},
                                  {1, 10, 2000, true}};
constexpr Round kEpipolarRounds[] = {
    {4, 3, 400, true}, {2, 4, 800, true}, {1, 10, 2000, true}};
constexpr Round kAttachedRounds[] = {{2, 4, 800, true}, {1, 6, 2000, true}};
constexpr Round kPaperRounds[] = {
    {1, 25, std::numeric_limits<int>::max(), false}};

struct Candidate {
  TwoViewModel model;
  bool with_depth = false;
  TwoViewScore score;
  // By which candidates with the same terms compare.
  double cost = std::numeric_limits<double>::infinity();
  int num_depth_inliers = 0;
  int num_trials = 0;
};

class Estimator {
 public:
  Estimator(const TwoViewDepthInput& input, const TwoViewDepthOptions& options)
      : options_(options),
        range_(FocalRange::Create(input, options)),
        random_(input.seed) {
    const DepthMatches& matches = input.matches;
    order_.resize(matches.points1.size());
    for (size_t i = 0; i < order_.size(); ++i) order_[i] = i;
    // Scores give up on bad models early if the order says nothing.
    Shuffle(&random_, &order_);
    for (const int i : order_) {
      data_.points1.push_back(matches.points1[i]);
      data_.points2.push_back(matches.points2[i]);
      const double depth1 = matches.depths1[i];
      const double depth2 = matches.depths2[i];
      const bool known = depth1 > 0 && depth2 > 0 && std::isfinite(depth1) &&
                         std::isfinite(depth2);
      data_.depths1.push_back(known ? depth1 : 0);
      data_.depths2.push_back(known ? depth2 : 0);
      num_depth_matches_ += known;
    }
  }

  TwoViewDepthResult Run();

 private:
  TwoViewCostOptions CostOptions(DepthTerm depth_term) const;
  DepthTerm SearchTerm(bool with_depth) const;
  double DepthCap() const;
  Candidate Evaluate(const TwoViewModel& model, bool with_depth) const;
  Candidate Optimize(const TwoViewModel& model,
                     const Round* rounds,
                     size_t num_rounds,
                     bool with_depth) const;
  void Consider(const Hypothesis& hypothesis, Candidate* best) const;
  Candidate Search();
  int NumTrials(double inlier_ratio, int sample_size, double share) const;
  std::vector<int> Inliers(const TwoViewModel& model) const;
  TwoViewCostOptions EstimateNoise(const TwoViewModel& model,
                                   bool with_depth,
                                   double* depth_noise) const;
  TwoViewData WithoutWrongDepths(const TwoViewModel& model,
                                 double max_error_px,
                                 double depth_noise) const;
  void Finish(Candidate* candidate, TwoViewDepthResult* result) const;
  void RefineWithoutDepth(Candidate* candidate) const;
  static bool IsWithinNoise(const Eigen::Vector3d& translation,
                            const TwoViewMatrix& covariance);
  bool AttachScale(TwoViewModel* model) const;
  void Report(const Candidate& candidate, TwoViewDepthResult* result) const;

  const TwoViewDepthOptions& options_;
  const FocalRange range_;
  SplitMix64 random_;
  std::vector<int> order_;  // data_ index to match
  TwoViewData data_;
  int num_depth_matches_ = 0;
};

TwoViewCostOptions Estimator::CostOptions(DepthTerm depth_term) const {
  TwoViewCostOptions cost_options;
  cost_options.depth_term = depth_term;
  cost_options.stddev_px = kStddevPerThreshold * options_.max_epipolar_error_px;
  cost_options.max_epipolar_error_px = options_.max_epipolar_error_px;
  cost_options.max_reprojection_error_px = options_.max_reprojection_error_px;
  cost_options.focal_prior1_px = range_.guess1;
  cost_options.focal_prior2_px = range_.guess2;
  cost_options.log_focal_prior_stddev =
      options_.paper ? 0 : kLogFocalPriorStddev;
  return cost_options;
}

DepthTerm Estimator::SearchTerm(bool with_depth) const {
  if (!with_depth) return DepthTerm::NONE;
  return options_.paper ? DepthTerm::REPROJECTION : DepthTerm::WHITENED;
}

// Factor of depth noise that makes all matches tell as much as the independent
// ones; half of the matches taken for inliers.
double Estimator::DepthCap() const {
  return std::sqrt(
      std::max(1.0, 0.5 * num_depth_matches_ / kNumIndependentDepths));
}

// Sampson error and cheirality decide what fits; where they cannot tell
// (planes, pure rotation), the depths do. A model without depth pays for all
// of them.
Candidate Estimator::Evaluate(const TwoViewModel& model,
                              bool with_depth) const {
  Candidate candidate;
  candidate.model = model;
  candidate.with_depth = with_depth;
  if (!model.IsFinite() || !range_.Contains(model)) return candidate;
  candidate.score = ScoreModel(data_,
                               model,
                               options_.max_epipolar_error_px,
                               std::numeric_limits<double>::infinity());
  candidate.cost = candidate.score.cost;
  const TwoViewCostOptions cost_options = CostOptions(DepthTerm::WHITENED);
  double depth_cost = num_depth_matches_ * cost_options.max_depth_residual *
                      cost_options.max_depth_residual;
  if (with_depth) {
    const TwoViewCost cost = EvaluateCost(data_, model, cost_options);
    candidate.num_depth_inliers = cost.num_depth_inliers;
    depth_cost = cost.depth;
  }
  if (!options_.paper) {
    const double weight = cost_options.stddev_px / DepthCap();
    candidate.cost += weight * weight * depth_cost;
  }
  return candidate;
}

Candidate Estimator::Optimize(const TwoViewModel& start,
                              const Round* rounds,
                              size_t num_rounds,
                              bool with_depth) const {
  // Wrong depths are many times their noise off, they need no wider basin.
  constexpr double kMaxDepthWidening = 4;
  TwoViewModel model = start;
  for (size_t k = 0; k < num_rounds; ++k) {
    const Round& round = rounds[k];
    TwoViewCostOptions cost_options = CostOptions(SearchTerm(with_depth));
    cost_options.max_epipolar_error_px *= round.widening;
    cost_options.max_depth_residual *=
        std::min(round.widening, kMaxDepthWidening);
    cost_options.max_num_matches = round.max_num_matches;
    if (round.capped) cost_options.log_depth_stddev *= DepthCap();
    RefineModel(data_,
                range_.focal_case,
                cost_options,
                round.max_num_iterations,
                &model);
  }
  return Evaluate(model, with_depth);
}

int Estimator::NumTrials(double inlier_ratio,
                         int sample_size,
                         double share) const {
  // Samples of inliers alone are not all good under noise.
  constexpr double kMargin = 3;
  const double good = share * std::pow(inlier_ratio, sample_size);
  if (good >= 1) return options_.min_num_trials;
  const double num =
      kMargin * std::log1p(-options_.confidence) / std::log1p(-good);
  // Also if it is infinite or not a number.
  if (!(num < options_.max_num_trials)) return options_.max_num_trials;
  return std::max(options_.min_num_trials, static_cast<int>(std::ceil(num)));
}

// Works a hypothesis out; the better of it and the best so far stays.
void Estimator::Consider(const Hypothesis& hypothesis, Candidate* best) const {
  const auto keep = [best](const Candidate& candidate) {
    if (candidate.cost < best->cost) *best = candidate;
  };
  for (TwoViewModel model : ExpandHypothesis(
           hypothesis, data_, range_, options_.max_epipolar_error_px)) {
    if (!hypothesis.is_fundamental) {
      keep(Evaluate(model, true));
      keep(options_.paper
               ? Optimize(model, kPaperRounds, std::size(kPaperRounds), true)
               : Optimize(model, kDepthRounds, std::size(kDepthRounds), true));
      continue;
    }
    const Candidate without_depth =
        Optimize(model, kEpipolarRounds, std::size(kEpipolarRounds), false);
    keep(without_depth);
    model = without_depth.model;
    if (num_depth_matches_ > 0 && AttachScale(&model)) {
      keep(Optimize(model, kAttachedRounds, std::size(kAttachedRounds), true));
    }
  }
}

Candidate Estimator::Search() {
  struct Stream {
    std::unique_ptr<HypothesisSource> source;
    double best_minimal_cost = std::numeric_limits<double>::infinity();
  };
  Stream depth, epipolar;
  if (num_depth_matches_ >= options_.min_num_depth_matches) {
    depth.source = CreateDepthHypothesisSource(data_, range_);
  }
  // Smooth errors of a depth map mislead all its samples alike, so samples
  // without depth take part: half of them, more where depth turns out to be
  // useless.
  if (!options_.paper || !depth.source) {
    epipolar.source = CreateEpipolarHypothesisSource(data_, range_);
  }
  double depth_share = !depth.source ? 0 : !epipolar.source ? 1 : 0.5;

  Candidate best;
  std::vector<Hypothesis> hypotheses;
  int num_trials = options_.max_num_trials;
  int trial = 0;
  for (; trial < num_trials && (depth.source || epipolar.source); ++trial) {
    const bool use_depth = random_.Below(1024) < depth_share * 1024;
    Stream& stream = use_depth ? depth : epipolar;
    stream.source->Sample(&random_, &hypotheses);
    for (const Hypothesis& hypothesis : hypotheses) {
      const TwoViewScore score =
          hypothesis.is_fundamental
              ? ScoreFundamentalMatrix(data_,
                                       hypothesis.fundamental,
                                       options_.max_epipolar_error_px,
                                       stream.best_minimal_cost)
              : ScoreModel(data_,
                           hypothesis.model,
                           options_.max_epipolar_error_px,
                           stream.best_minimal_cost);
      if (!(score.cost < stream.best_minimal_cost)) continue;
      stream.best_minimal_cost = score.cost;
      Consider(hypothesis, &best);
    }
    const double inlier_ratio =
        static_cast<double>(best.score.num_inliers) / data_.Size();
    // Inliers whose depths are right, too.
    const double depth_inlier_ratio =
        num_depth_matches_ == 0
            ? 0
            : std::min(inlier_ratio,
                       static_cast<double>(best.num_depth_inliers) /
                           num_depth_matches_);
    if (trial == options_.min_num_trials && epipolar.source && depth.source &&
        depth_inlier_ratio < 0.5 * inlier_ratio) {
      depth_share = 0.25;
    }
    num_trials = options_.max_num_trials;
    if (depth.source) {
      num_trials =
          std::min(num_trials, NumTrials(depth_inlier_ratio, 3, depth_share));
    }
    if (epipolar.source) {
      num_trials = std::min(
          num_trials,
          NumTrials(
              inlier_ratio, epipolar.source->SampleSize(), 1 - depth_share));
    }
  }
  best.num_trials = trial;
  return best;
}

std::vector<int> Estimator::Inliers(const TwoViewModel& model) const {
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  const Cheirality cheirality(model, options_.max_epipolar_error_px);
  std::vector<int> inliers;
  for (int i = 0; i < data_.Size(); ++i) {
    if (std::abs(SampsonError(F, data_.points1[i], data_.points2[i])) <
            options_.max_epipolar_error_px &&
        cheirality(data_.points1[i], data_.points2[i])) {
      inliers.push_back(i);
    }
  }
  return inliers;
}

TwoViewCostOptions Estimator::EstimateNoise(const TwoViewModel& model,
                                            bool with_depth,
                                            double* depth_noise) const {
  // Slowly varying errors do not show in the scatter of the ratios.
  constexpr double kMinLogDepthStddev = 0.03;
  constexpr double kMinStddevPerThreshold = 0.1;
  // Outliers by chance within the threshold are far out of an exact model.
  constexpr double kMaxEpipolarErrorPerStddev = 4;
  constexpr double kMinMaxEpipolarErrorRatio = 1e-3;
  TwoViewCostOptions cost_options = CostOptions(SearchTerm(with_depth));
  cost_options.cauchy = true;
  if (options_.paper) return cost_options;
  const double max_error = options_.max_epipolar_error_px;
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  std::vector<double> errors_px;
  std::vector<double> log_depth_ratios;
  for (const int i : Inliers(model)) {
    errors_px.push_back(SampsonError(F, data_.points1[i], data_.points2[i]));
    Transfer transfer;
    if (with_depth && data_.HasDepths(i) &&
        TransferForward(model,
                        data_.points1[i],
                        data_.depths1[i],
                        data_.points2[i],
                        data_.depths2[i],
                        &transfer)) {
      log_depth_ratios.push_back(transfer.log_depth_ratio);
    }
  }
  if (!errors_px.empty()) {
    const double stddev = RobustStddev(errors_px, 0);
    cost_options.stddev_px = std::clamp(stddev,
                                        kMinStddevPerThreshold * max_error,
                                        kStddevPerThreshold * max_error);
    cost_options.max_epipolar_error_px =
        std::clamp(kMaxEpipolarErrorPerStddev * stddev,
                   kMinMaxEpipolarErrorRatio * max_error,
                   max_error);
  }
  if (log_depth_ratios.size() >= kMinNumInliers) {
    *depth_noise = RobustStddev(log_depth_ratios, Median(log_depth_ratios)) /
                   std::sqrt(2.0);
    cost_options.log_depth_stddev =
        std::max(*depth_noise, kMinLogDepthStddev) *
        std::sqrt(
            std::max(1.0, log_depth_ratios.size() / kNumIndependentDepths));
  }
  return cost_options;
}

// The matches without the depths of outliers and those that are wrong under the
// noise of the good ones: the capped noise of the refinement would let them
// pass.
TwoViewData Estimator::WithoutWrongDepths(const TwoViewModel& model,
                                          double max_error_px,
                                          double depth_noise) const {
  constexpr double kMaxDeviation = 4;
  constexpr double kMinLogDepthStddev = 1e-3;
  const double max_log_ratio = kMaxDeviation * std::sqrt(2.0) *
                               std::max(depth_noise, kMinLogDepthStddev);
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  TwoViewData data = data_;
  for (int i = 0; i < data.Size(); ++i) {
    Transfer transfer;
    if (!data.HasDepths(i)) continue;
    if (std::abs(SampsonError(F, data.points1[i], data.points2[i])) >
            max_error_px ||
        !TransferForward(model,
                         data.points1[i],
                         data.depths1[i],
                         data.points2[i],
                         data.depths2[i],
                         &transfer) ||
        std::abs(transfer.log_depth_ratio) > max_log_ratio) {
      data.depths1[i] = data.depths2[i] = 0;
    }
  }
  return data;
}

void Estimator::Finish(Candidate* candidate, TwoViewDepthResult* result) const {
  constexpr int kNumRounds = 3;
  constexpr int kMaxNumIterations = 50;
  TwoViewModel model = candidate->model;
  TwoViewCostOptions cost_options;
  TwoViewData data = data_;
  for (int round = 0; round < kNumRounds; ++round) {
    cost_options =
        EstimateNoise(model, candidate->with_depth, &result->depth_noise);
    if (candidate->with_depth && !options_.paper) {
      data = WithoutWrongDepths(
          model, cost_options.max_epipolar_error_px, result->depth_noise);
    }
    if (round + 1 == kNumRounds) {
      cost_options.min_relative_decrease = kMinFinalDecrease;
    }
    RefineModel(
        data, range_.focal_case, cost_options, kMaxNumIterations, &model);
  }
  TwoViewMatrix covariance =
      EstimateCovariance(data, range_.focal_case, cost_options, model);
  const double stddev1 =
      std::sqrt(covariance(kLogFocal1Param, kLogFocal1Param));
  const double stddev2 =
      std::sqrt(covariance(kLogFocal2Param, kLogFocal2Param));
  if (range_.focal_case != FocalCase::KNOWN &&
      std::max(stddev1, stddev2) < kMaxPriorFreeLogFocalStddev) {
    cost_options.log_focal_prior_stddev = 0;
    RefineModel(
        data, range_.focal_case, cost_options, kMaxNumIterations, &model);
  }
  // Refinement with a soft loss may trade inliers; a real loss means that it
  // has left the model that was found.
  constexpr double kMinKeptInliers = 0.9;
  Candidate refined = Evaluate(model, candidate->with_depth);
  refined.num_trials = candidate->num_trials;
  if (refined.score.num_inliers >=
      kMinKeptInliers * candidate->score.num_inliers) {
    *candidate = refined;
  }
  if (range_.focal_case == FocalCase::KNOWN && candidate->with_depth &&
      !options_.paper) {
    RefineWithoutDepth(candidate);
  }
  TwoViewDegeneracy& degeneracy = result->degeneracy;
  degeneracy.focal_identifiable1 = stddev1 < kMaxLogFocalStddev;
  degeneracy.focal_identifiable2 = stddev2 < kMaxLogFocalStddev;
  result->estimated_focal1 = range_.focal_case != FocalCase::KNOWN &&
                             range_.focal_case != FocalCase::ONE_SIDED1 &&
                             degeneracy.focal_identifiable1;
  result->estimated_focal2 = range_.focal_case != FocalCase::KNOWN &&
                             range_.focal_case != FocalCase::ONE_SIDED2 &&
                             degeneracy.focal_identifiable2;
  covariance = EstimateCovariance(
      data, range_.focal_case, cost_options, candidate->model);
  result->has_covariance = candidate->with_depth && covariance.allFinite();
  if (result->has_covariance) {
    result->covariance = covariance;
    degeneracy.rotation_only =
        IsWithinNoise(candidate->model.translation, covariance);
  }
}

// Whether the translation is zero by its covariance.
bool Estimator::IsWithinNoise(const Eigen::Vector3d& translation,
                              const TwoViewMatrix& covariance) {
  constexpr double kMaxSqDeviation = 9;
  const Eigen::Matrix3d block = covariance.block<3, 3>(3, 3);
  return translation.dot(block.ldlt().solve(translation)) < kMaxSqDeviation;
}

// With known focal lengths and parallax the image points alone give the better
// pose: errors of depth maps are smooth and do not average out.
void Estimator::RefineWithoutDepth(Candidate* candidate) const {
  constexpr int kMaxNumIterations = 50;
  constexpr int kMinNumPoints = 30;
  constexpr double kMinAngleRad = 3 * M_PI / 180;
  std::vector<double> angles;
  for (const int i : Inliers(candidate->model)) {
    const auto intersection =
        IntersectRays(candidate->model, data_.points1[i], data_.points2[i]);
    angles.push_back(intersection ? intersection->angle_rad : 0);
  }
  if (angles.size() < kMinNumPoints || Median(angles) < kMinAngleRad) return;
  double depth_noise = 0;
  TwoViewModel model = candidate->model;
  model.translation.normalize();
  TwoViewCostOptions cost_options =
      EstimateNoise(model, /*with_depth=*/false, &depth_noise);
  cost_options.min_relative_decrease = kMinFinalDecrease;
  RefineModel(
      data_, range_.focal_case, cost_options, kMaxNumIterations, &model);
  if (!model.IsFinite() || !AttachScale(&model)) return;
  Candidate refined = Evaluate(model, true);
  refined.num_trials = candidate->num_trials;
  if (refined.score.cost <= candidate->score.cost) *candidate = refined;
}

bool Estimator::AttachScale(TwoViewModel* model) const {
  std::vector<double> log_ratios1, log_ratios2;
  for (const int i : Inliers(*model)) {
    if (!data_.HasDepths(i)) continue;
    const auto intersection =
        IntersectRays(*model, data_.points1[i], data_.points2[i]);
    if (!intersection || intersection->angle_rad < kMinScaleAngleRad) continue;
    log_ratios1.push_back(std::log(data_.depths1[i] / intersection->depth1));
    log_ratios2.push_back(std::log(data_.depths2[i] / intersection->depth2));
  }
  if (log_ratios1.size() < kMinNumScalePoints) return false;
  const double log_ratio1 = Median(log_ratios1);
  const double log_ratio2 = Median(log_ratios2);
  if (RobustStddev(log_ratios1, log_ratio1) > 1.4826 * kMaxScaleDeviation ||
      RobustStddev(log_ratios2, log_ratio2) > 1.4826 * kMaxScaleDeviation) {
    return false;
  }
  model->translation *= std::exp(log_ratio1);
  model->scale = std::exp(log_ratio1 - log_ratio2);
  return true;
}

void Estimator::Report(const Candidate& candidate,
                       TwoViewDepthResult* result) const {
  TwoViewModel model = candidate.model;
  const std::vector<int> inliers = Inliers(model);
  result->num_inliers = static_cast<int>(inliers.size());
  result->inlier_mask.assign(order_.size(), 0);
  std::vector<double> angles;
  int num_stationary = 0;
  for (const int i : inliers) {
    result->inlier_mask[order_[i]] = 1;
    num_stationary += (data_.points1[i] - data_.points2[i]).norm() <
                      2 * options_.max_epipolar_error_px;
    const auto intersection =
        IntersectRays(model, data_.points1[i], data_.points2[i]);
    angles.push_back(intersection ? intersection->angle_rad : 0);
  }
  result->success = result->num_inliers >= kMinNumInliers;
  result->degeneracy.stationary = 2 * num_stationary > result->num_inliers;
  if (!angles.empty()) {
    result->median_triangulation_angle_deg = Median(angles) * 180 / M_PI;
  }
  result->num_trials = candidate.num_trials;
  result->used_depth_free_estimator = !candidate.with_depth;
  result->has_scale = candidate.with_depth
                          ? candidate.num_depth_inliers >= kMinNumInliers
                          : AttachScale(&model);
  if (!result->has_scale) {
    model.scale = 1;
    if (model.translation.norm() > 0) model.translation.normalize();
    result->has_covariance = false;
    result->covariance.setZero();
  }
  result->cam2_from_cam1 = Rigid3d(
      Eigen::Quaterniond(model.rotation).normalized(), model.translation);
  result->scale_1_from_2 = model.scale;
  result->focal_length1_px = model.focal1;
  result->focal_length2_px = model.focal2;
}

TwoViewDepthResult Estimator::Run() {
  TwoViewDepthResult result;
  result.inlier_mask.assign(order_.size(), 0);
  result.focal_length1_px = range_.guess1;
  result.focal_length2_px = range_.guess2;
  Candidate best = Search();
  if (std::isfinite(best.cost)) {
    Finish(&best, &result);
    Report(best, &result);
  }
  result.num_trials = best.num_trials;
  return result;
}

void CheckInput(const TwoViewDepthInput& input,
                const TwoViewDepthOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const DepthMatches& matches = input.matches;
  const size_t size = matches.points1.size();
  DGSFM_CHECK(matches.points2.size() == size &&
              matches.depths1.size() == size && matches.depths2.size() == size)
      << "arrays of " << size << ", " << matches.points2.size() << ", "
      << matches.depths1.size() << " and " << matches.depths2.size()
      << " elements";
  for (size_t i = 0; i < size; ++i) {
    DGSFM_CHECK(matches.points1[i].allFinite() &&
                matches.points2[i].allFinite())
        << "match " << i;
  }
  for (const double value : {input.focal_length1_px,
                             input.focal_length2_px,
                             input.image_size1_px,
                             input.image_size2_px}) {
    DGSFM_CHECK(value > 0 && std::isfinite(value)) << "value = " << value;
  }
}

}  // namespace

bool TwoViewDepthOptions::IsValid(std::string* error) const {
  const auto check =
      [error](bool ok, const char* name, double value, const char* bound) {
        if (!ok && error) {
          *error += std::string(name) + " = " + std::to_string(value) +
                    " must be " + bound + "\n";
        }
        return ok;
      };
  bool ok = true;
  ok &= check(max_epipolar_error_px > 0 && std::isfinite(max_epipolar_error_px),
              "max_epipolar_error_px",
              max_epipolar_error_px,
              "> 0");
  ok &= check(
      max_reprojection_error_px > 0 && std::isfinite(max_reprojection_error_px),
      "max_reprojection_error_px",
      max_reprojection_error_px,
      "> 0");
  ok &= check(min_num_trials >= 1, "min_num_trials", min_num_trials, ">= 1");
  ok &= check(max_num_trials >= min_num_trials,
              "max_num_trials",
              max_num_trials,
              ">= min_num_trials");
  ok &= check(
      confidence > 0 && confidence < 1, "confidence", confidence, "in (0, 1)");
  ok &= check(min_focal_length_ratio > 0,
              "min_focal_length_ratio",
              min_focal_length_ratio,
              "> 0");
  ok &= check(max_focal_length_ratio > min_focal_length_ratio,
              "max_focal_length_ratio",
              max_focal_length_ratio,
              "> min_focal_length_ratio");
  ok &= check(min_num_depth_matches >= 3,
              "min_num_depth_matches",
              min_num_depth_matches,
              ">= 3");
  return ok;
}

TwoViewDepthResult EstimateTwoViewGeometryWithDepth(
    const TwoViewDepthInput& input, const TwoViewDepthOptions& options) {
  CheckInput(input, options);
  return Estimator(input, options).Run();
}

}  // namespace dgsfm
