#include "estimators/two_view/two_view_published.h"

#include <algorithm>
#include <limits>

namespace dgsfm {
namespace {

// Points behind the cameras count only against models with known focal lengths.
bool ChecksCheirality(const TwoViewProblem& problem) {
  return problem.Range().focal_case == FocalCase::KNOWN;
}

TwoViewScore Score(const TwoViewProblem& problem, const TwoViewModel& model) {
  const TwoViewScorer& scorer = problem.Scorer();
  return ChecksCheirality(problem) ? scorer.Score(model)
                                   : scorer.Score(model.FundamentalMatrix());
}

std::vector<int> Inliers(const TwoViewProblem& problem,
                         const TwoViewModel& model) {
  return ChecksCheirality(problem)
             ? problem.Inliers(model)
             : problem.Near(model,
                            problem.Options().max_epipolar_error_px,
                            static_cast<int>(problem.Data().size()));
}

// The published costs have no priors.
TwoViewCostOptions CostOptions(const TwoViewProblem& problem) {
  TwoViewCostOptions cost_options = problem.CostOptions(/*with_depth=*/true);
  cost_options.depth_term = DepthTerm::REPROJECTION;
  cost_options.focal_prior1 = cost_options.focal_prior2 = FocalPrior();
  return cost_options;
}

void Refine(const TwoViewProblem& problem,
            const TwoViewData& data,
            const TwoViewCostOptions& cost_options,
            int max_num_iterations,
            TwoViewModel* model) {
  TwoViewRefinementOptions options;
  options.max_num_iterations = max_num_iterations;
  // The number of iterations or rounding ends it.
  options.min_relative_decrease = 0;
  RefineModel(data, problem.Range().focal_case, cost_options, options, model);
}

// A model refined over all matches.
TwoViewModel Optimized(const TwoViewProblem& problem, TwoViewModel model) {
  constexpr int kMaxNumIterations = 25;
  Refine(
      problem, problem.Data(), CostOptions(problem), kMaxNumIterations, &model);
  return model;
}

// The published samples have no range of focal lengths.
HypothesisSource CreateSource(const TwoViewProblem& problem) {
  FocalRange any = problem.Range();
  for (FocalBounds* view : {&any.view1, &any.view2}) {
    view->min_px = 0;
    view->max_px = std::numeric_limits<double>::infinity();
  }
  return CreateDepthHypothesisSource(problem.Data(), any, /*guess_interval=*/0);
}

}  // namespace

TwoViewSearchResult SearchPublishedModel(const TwoViewProblem& problem,
                                         SplitMix64* random) {
  TwoViewSearchResult result;
  TwoViewCandidate& best = result.with_depth;
  const auto keep = [&](const TwoViewModel& model, const TwoViewScore& score) {
    if (!model.IsFinite() || !(score.cost < best.cost)) return;
    best.model = model;
    best.with_depth = true;
    best.score = score;
    best.cost = score.cost;
    best.num_depth_inliers = score.num_inliers;
  };
  const auto keep_optimized = [&](const TwoViewModel& start) {
    const TwoViewModel model = Optimized(problem, start);
    keep(model, Score(problem, model));
  };
  const HypothesisSource source = CreateSource(problem);
  if (source.sample_size == 0) return result;
  // Best score among models of samples alone: optimised ones would leave
  // nothing to optimise.
  TwoViewScore best_sample;
  while (result.num_trials < problem.Options().max_num_trials) {
    ++result.num_trials;
    const std::vector<Hypothesis> hypotheses = source.sample(random);
    const TwoViewModel* promising = nullptr;
    for (const Hypothesis& hypothesis : hypotheses) {
      const TwoViewScore score = Score(problem, hypothesis.model);
      if (!(score.cost < best_sample.cost) &&
          score.num_inliers <= best_sample.num_inliers) {
        continue;
      }
      best_sample.cost = std::min(best_sample.cost, score.cost);
      best_sample.num_inliers =
          std::max(best_sample.num_inliers, score.num_inliers);
      promising = &hypothesis.model;
      keep(hypothesis.model, score);
    }
    if (promising) keep_optimized(*promising);
  }
  if (best.with_depth) keep_optimized(best.model);
  return result;
}

PublishedRefinement RefinePublishedModel(const TwoViewProblem& problem,
                                         const TwoViewModel& model) {
  constexpr int kMaxNumIterations = 100;
  // The scale of the loss by the thresholds.
  constexpr double kLossRatioOfKnownFocals = 0.5;
  PublishedRefinement result;
  result.model = model;
  result.inliers = Inliers(problem, model);
  const TwoViewData data = Subset(problem.Data(), result.inliers);
  const FocalCase focal_case = problem.Range().focal_case;
  TwoViewCostOptions cost_options = CostOptions(problem);
  cost_options.loss = TwoViewLoss::CAUCHY;
  if (focal_case == FocalCase::KNOWN) {
    cost_options.max_epipolar_error_px *= kLossRatioOfKnownFocals;
    cost_options.max_reprojection_error_px *= kLossRatioOfKnownFocals;
  }
  Refine(problem, data, cost_options, kMaxNumIterations, &result.model);
  result.covariance = EstimateCovariance(
      data, focal_case, cost_options, result.model, DepthFields::Zero());
  return result;
}

}  // namespace dgsfm
