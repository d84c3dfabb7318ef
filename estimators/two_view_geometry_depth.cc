#include "estimators/two_view_geometry_depth.h"

#include "colmap_ext/check.h"
#include "estimators/random.h"
#include "estimators/solvers/epipolar.h"
#include "estimators/two_view_cost.h"
#include "estimators/two_view_hypotheses.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace dgsfm {
namespace {

// Smallest support that tells a model from a coincidence of its own sample.
constexpr int kMinNumInliers = 8;
// Matches are trusted to a fraction of the inlier threshold.
constexpr double kStddevPerThreshold = 0.5;
// Depth errors of a network vary slowly over an image: a pair has no more than
// about this many independent ones, however many matches there are.
constexpr double kNumIndependentDepths = 30;
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
  Candidate Evaluate(const TwoViewModel& model, bool with_depth) const;
  Candidate Optimize(const TwoViewModel& model, bool with_depth) const;
  Candidate Search(HypothesisSource* source, bool with_depth);
  int NumTrials(const TwoViewScore& score, int sample_size, int max_num) const;
  bool DepthConvinces(const Candidate& candidate) const;
  std::vector<int> Inliers(const TwoViewModel& model) const;
  TwoViewCostOptions EstimateNoise(const TwoViewModel& model,
                                   bool with_depth,
                                   double* depth_noise) const;
  void Finish(Candidate* candidate, TwoViewDepthResult* result) const;
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

// Sampson error and cheirality decide what fits; where they cannot tell
// (planes, pure rotation), the depths do.
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
  if (with_depth) {
    const TwoViewCostOptions cost_options = CostOptions(DepthTerm::WHITENED);
    const TwoViewCost cost = EvaluateCost(data_, model, cost_options);
    candidate.num_depth_inliers = cost.num_depth_inliers;
    if (!options_.paper) {
      candidate.cost +=
          cost.depth * cost_options.stddev_px * cost_options.stddev_px;
    }
  }
  return candidate;
}

Candidate Estimator::Optimize(const TwoViewModel& start,
                              bool with_depth) const {
  struct Round {
    double widening;
    int max_num_iterations;
  };
  // Minimal models are off by more than the inlier threshold; a wide basin
  // first brings them in.
  constexpr Round kAnnealed[] = {{4, 5}, {2, 5}, {1, 15}};
  constexpr Round kPaper[] = {{1, 25}};
  const Round* rounds = options_.paper ? kPaper : kAnnealed;
  const size_t num_rounds =
      options_.paper ? std::size(kPaper) : std::size(kAnnealed);
  TwoViewModel model = start;
  for (size_t k = 0; k < num_rounds; ++k) {
    TwoViewCostOptions cost_options = CostOptions(SearchTerm(with_depth));
    cost_options.max_epipolar_error_px *= rounds[k].widening;
    cost_options.max_depth_residual *= rounds[k].widening;
    RefineModel(data_,
                range_.focal_case,
                cost_options,
                rounds[k].max_num_iterations,
                &model);
  }
  return Evaluate(model, with_depth);
}

int Estimator::NumTrials(const TwoViewScore& score,
                         int sample_size,
                         int max_num) const {
  // Samples of inliers alone are not all good under noise.
  constexpr double kMargin = 3;
  const double good = std::pow(
      static_cast<double>(score.num_inliers) / data_.Size(), sample_size);
  if (good >= 1) return options_.min_num_trials;
  const double num =
      kMargin * std::log1p(-options_.confidence) / std::log1p(-good);
  // A comparison with NaN or infinity is false: keep the maximum.
  if (!(num < max_num)) return max_num;
  return std::max(options_.min_num_trials, static_cast<int>(std::ceil(num)));
}

Candidate Estimator::Search(HypothesisSource* source, bool with_depth) {
  const double max_error = options_.max_epipolar_error_px;
  const int max_num_trials = options_.max_num_trials;
  Candidate best;
  double best_minimal_cost = std::numeric_limits<double>::infinity();
  int num_trials = max_num_trials;
  int trial = 0;
  std::vector<Hypothesis> hypotheses;
  for (; trial < num_trials; ++trial) {
    source->Sample(&random_, &hypotheses);
    for (const Hypothesis& hypothesis : hypotheses) {
      const TwoViewScore score =
          hypothesis.is_fundamental
              ? ScoreFundamentalMatrix(
                    data_, hypothesis.fundamental, max_error, best_minimal_cost)
              : ScoreModel(
                    data_, hypothesis.model, max_error, best_minimal_cost);
      if (!(score.cost < best_minimal_cost)) continue;
      best_minimal_cost = score.cost;
      for (const TwoViewModel& model :
           ExpandHypothesis(hypothesis, data_, range_, max_error)) {
        for (const Candidate& candidate :
             {Optimize(model, with_depth), Evaluate(model, with_depth)}) {
          if (candidate.cost < best.cost) best = candidate;
        }
      }
      num_trials = NumTrials(best.score, source->SampleSize(), max_num_trials);
    }
  }
  best.num_trials = trial;
  return best;
}

// Whether there is no need to look for something better without depth.
bool Estimator::DepthConvinces(const Candidate& candidate) const {
  constexpr double kMinDepthInlierRatio = 0.5;
  constexpr double kMinInlierRatio = 0.3;
  int num_with_depth = 0;
  for (const int i : Inliers(candidate.model)) {
    num_with_depth += data_.HasDepths(i);
  }
  return candidate.score.num_inliers >= kMinNumScalePoints &&
         candidate.score.num_inliers > kMinInlierRatio * data_.Size() &&
         num_with_depth > 0.3 * candidate.score.num_inliers &&
         candidate.num_depth_inliers > kMinDepthInlierRatio * num_with_depth;
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
  constexpr double kMinLogDepthStddev = 0.01;
  TwoViewCostOptions cost_options = CostOptions(SearchTerm(with_depth));
  cost_options.cauchy = true;
  if (options_.paper) return cost_options;
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
    cost_options.stddev_px =
        std::clamp(RobustStddev(errors_px, 0),
                   0.1 * options_.max_epipolar_error_px,
                   kStddevPerThreshold * options_.max_epipolar_error_px);
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

void Estimator::Finish(Candidate* candidate, TwoViewDepthResult* result) const {
  constexpr int kNumRounds = 2;
  constexpr int kMaxNumIterations = 50;
  TwoViewModel model = candidate->model;
  TwoViewCostOptions cost_options;
  double stddev1 = std::numeric_limits<double>::infinity();
  double stddev2 = stddev1;
  for (int round = 0; round < kNumRounds; ++round) {
    cost_options =
        EstimateNoise(model, candidate->with_depth, &result->depth_noise);
    RefineModel(
        data_, range_.focal_case, cost_options, kMaxNumIterations, &model);
    const TwoViewMatrix covariance =
        EstimateCovariance(data_, range_.focal_case, cost_options, model);
    stddev1 = std::sqrt(covariance(kLogFocal1Param, kLogFocal1Param));
    stddev2 = std::sqrt(covariance(kLogFocal2Param, kLogFocal2Param));
  }
  if (range_.focal_case != FocalCase::KNOWN &&
      std::max(stddev1, stddev2) < kMaxPriorFreeLogFocalStddev) {
    cost_options.log_focal_prior_stddev = 0;
    RefineModel(
        data_, range_.focal_case, cost_options, kMaxNumIterations, &model);
  }
  // Refinement with a soft loss may trade inliers; a real loss means that it
  // has left the model that was found.
  constexpr double kMinKeptInliers = 0.9;
  const Candidate refined = Evaluate(model, candidate->with_depth);
  if (refined.score.num_inliers >=
      kMinKeptInliers * candidate->score.num_inliers) {
    const int num_trials = candidate->num_trials;
    *candidate = refined;
    candidate->num_trials = num_trials;
  }
  result->estimated_focal1 = range_.focal_case != FocalCase::KNOWN &&
                             range_.focal_case != FocalCase::ONE_SIDED1 &&
                             stddev1 < kMaxLogFocalStddev;
  result->estimated_focal2 = range_.focal_case != FocalCase::KNOWN &&
                             range_.focal_case != FocalCase::ONE_SIDED2 &&
                             stddev2 < kMaxLogFocalStddev;
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
  for (const int i : inliers) {
    result->inlier_mask[order_[i]] = 1;
    const auto intersection =
        IntersectRays(model, data_.points1[i], data_.points2[i]);
    angles.push_back(intersection ? intersection->angle_rad : 0);
  }
  result->success = result->num_inliers >= kMinNumInliers;
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
  }
  result->cam2_from_cam1 = Rigid3d(
      Eigen::Quaterniond(model.rotation).normalized(), model.translation);
  result->scale_1_from_2 = model.scale;
  result->focal_length1_px = model.focal1;
  result->focal_length2_px = model.focal2;
}

TwoViewDepthResult Estimator::Run() {
  Candidate best;
  int num_trials = 0;
  if (num_depth_matches_ >= std::max(3, options_.min_num_depth_matches)) {
    best = Search(CreateDepthHypothesisSource(data_, range_).get(), true);
    num_trials += best.num_trials;
  }
  const bool found = std::isfinite(best.cost);
  if (!found || (!options_.paper && !DepthConvinces(best))) {
    const auto source = CreateEpipolarHypothesisSource(data_, range_);
    if (source) {
      const Candidate without_depth = Search(source.get(), false);
      num_trials += without_depth.num_trials;
      // A model without depth has less to obey: it fits better even if it is
      // not better.
      constexpr double kHandicap = 1.02;
      if (without_depth.score.cost * kHandicap < best.score.cost) {
        best = without_depth;
      }
    }
  }
  TwoViewDepthResult result;
  result.inlier_mask.assign(order_.size(), 0);
  result.focal_length1_px = range_.guess1;
  result.focal_length2_px = range_.guess2;
  if (std::isfinite(best.cost)) {
    Finish(&best, &result);
    Report(best, &result);
  }
  result.num_trials = num_trials;
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
