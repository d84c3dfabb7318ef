#include "estimators/two_view/two_view_search.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <vector>

namespace dgsfm {
namespace {

// A stage of local optimisation.
struct Round {
  // Factor of the thresholds.
  double widening;
  int max_num_iterations;
  // Enough matches for the accuracy of the stage.
  int max_num_matches;
  // Whether the depths count as no more than the independent ones.
  bool capped;
};

// Minimal models of noisy depths are off by much more than the inlier
// threshold: a wide basin first brings them in.
constexpr Round kRounds[] = {{16, 3, 100, false},
                             {8, 3, 100, false},
                             {4, 3, 100, true},
                             {2, 4, 200, true},
                             {1, 5, 300, true}};

// The first round of each kind of start. Models of samples with depth or with
// guessed focal lengths may be far off, models whose scale was attached have
// been optimized without depth.
enum FirstRound {
  FROM_DEPTH = 0,
  FROM_GUESS = 0,
  FROM_POINTS = 2,
  ATTACHED = 3
};

class Search {
 public:
  Search(const TwoViewProblem& problem, SplitMix64* random);

  TwoViewSearchResult Run();

 private:
  // Samples of one kind.
  struct Stream {
    HypothesisSource source;
    int num_trials = 0;
    double best_cost = std::numeric_limits<double>::infinity();
    Hypothesis best;
    bool is_optimized = true;
  };

  void Try(Stream* stream);
  void OptimizeBest(Stream* stream);
  void SampleNearBest();
  TwoViewCandidate Optimize(const TwoViewModel& start,
                            FirstRound first_round,
                            bool with_depth) const;
  void OptimizeWithoutDepth(const TwoViewModel& model);
  void Keep(const TwoViewCandidate& candidate);
  bool IsDone(const Stream& stream,
              double inlier_ratio,
              double confidence,
              double margin) const;
  bool IsHopeless() const;
  double InlierRatio() const;
  double DepthInlierRatio() const;
  bool DepthsAreUseful() const;

  const TwoViewProblem& problem_;
  const TwoViewDepthOptions& options_;
  SplitMix64* const random_;
  Stream depth_, epipolar_;
  TwoViewSearchResult result_;
};

Search::Search(const TwoViewProblem& problem, SplitMix64* random)
    : problem_(problem), options_(problem.Options()), random_(random) {
  // One sample in so many keeps the guessed focal lengths, which helps where
  // depth hardly determines them (small rotations).
  constexpr int kGuessInterval = 4;
  if (problem.Rotation()) {
    epipolar_.source = CreateTranslationHypothesisSource(
        problem.Data(), problem.Range(), *problem.Rotation());
    return;
  }
  if (problem.NumDepthMatches() >= options_.min_num_depth_matches) {
    depth_.source = CreateDepthHypothesisSource(
        problem.Data(), problem.Range(), kGuessInterval);
  }
  epipolar_.source =
      CreateEpipolarHypothesisSource(problem.Data(), problem.Range());
}

TwoViewSearchResult Search::Run() {
  // The best of so many samples is worth a local optimisation, the best of
  // fewer seldom is.
  constexpr int kMinNumTrialsToOptimize = 20;
  // Smooth errors of a depth map mislead all its samples alike, so samples
  // without depth take part: half of them, more where depth turns out to be
  // useless.
  constexpr double kDepthShare = 0.5;
  constexpr double kUselessDepthShare = 0.1;
  // Samples of inliers alone are not all good under noise.
  constexpr double kMargin = 2;
  const bool has_depth = depth_.source.sample_size > 0;
  const bool has_epipolar = epipolar_.source.sample_size > 0;
  double depth_share = !has_depth ? 0 : !has_epipolar ? 1 : kDepthShare;
  const int min_num_trials =
      std::min(kMinNumTrialsToOptimize, options_.min_num_trials / 2);
  while (has_depth || has_epipolar) {
    Stream& stream =
        random_->Below(1024) < depth_share * 1024 ? depth_ : epipolar_;
    Try(&stream);
    ++result_.num_trials;
    if (stream.num_trials >= min_num_trials && !stream.is_optimized) {
      OptimizeBest(&stream);
    }
    if (result_.num_trials < options_.min_num_trials) continue;
    const double inlier_ratio = InlierRatio();
    const double depth_inlier_ratio = DepthInlierRatio();
    if (result_.num_trials % options_.min_num_trials == 0 && has_depth &&
        has_epipolar) {
      depth_share = DepthsAreUseful() ? kDepthShare : kUselessDepthShare;
    }
    // Useless depth is to cost no trials of the other kind.
    const int num_counted = depth_share == kUselessDepthShare
                                ? epipolar_.num_trials
                                : result_.num_trials;
    if (IsDone(depth_, depth_inlier_ratio, options_.confidence, kMargin) ||
        IsDone(epipolar_, inlier_ratio, options_.confidence, kMargin) ||
        IsHopeless() || num_counted >= options_.max_num_trials) {
      break;
    }
  }
  if (!IsHopeless() && !problem_.Rotation()) SampleNearBest();
  return result_;
}

// Scores the hypotheses of one more sample.
void Search::Try(Stream* stream) {
  ++stream->num_trials;
  for (const Hypothesis& hypothesis : stream->source.sample(random_)) {
    const TwoViewScore score =
        hypothesis.is_fundamental
            ? problem_.Scorer().Score(hypothesis.fundamental, stream->best_cost)
            : problem_.Scorer().Score(hypothesis.model, stream->best_cost);
    if (!(score.cost < stream->best_cost)) continue;
    stream->best_cost = score.cost;
    stream->best = hypothesis;
    stream->is_optimized = false;
  }
}

void Search::OptimizeBest(Stream* stream) {
  stream->is_optimized = true;
  for (const TwoViewModel& model :
       ExpandHypothesis(stream->best,
                        problem_.Data(),
                        problem_.Range(),
                        options_.max_epipolar_error_px)) {
    if (stream->best.is_fundamental) {
      OptimizeWithoutDepth(model);
      if (stream->best.model.focal1 > 0 &&
          problem_.Range().focal_case != FocalCase::KNOWN) {
        Keep(Optimize(model, FROM_GUESS, false));
      }
    } else {
      Keep(Optimize(model, FROM_DEPTH, true));
    }
  }
}

void Search::OptimizeWithoutDepth(const TwoViewModel& model) {
  // Enough for a start.
  constexpr int kMaxNumScaleMatches = 300;
  const TwoViewCandidate candidate = Optimize(model, FROM_POINTS, false);
  Keep(candidate);
  TwoViewModel scaled = candidate.model;
  if (problem_.NumDepthMatches() > 0 &&
      problem_.AttachScale(&scaled, kMaxNumScaleMatches)) {
    Keep(Optimize(scaled, ATTACHED, true));
  }
}

// Local optimisation stops at the next minimum. Samples without depth among the
// matches near the best model are mostly good, also where few matches are, and
// lead out of it.
void Search::SampleNearBest() {
  constexpr int kNumRounds = 3;
  constexpr int kNumTrials = 20;
  constexpr double kWidening = 8;
  for (int round = 0; round < kNumRounds; ++round) {
    const TwoViewCandidate& best =
        result_.with_depth.score.cost < result_.without_depth.score.cost
            ? result_.with_depth
            : result_.without_depth;
    if (!std::isfinite(best.cost)) return;
    const TwoViewData& data = problem_.Data();
    const TwoViewData near =
        Subset(data,
               problem_.Near(best.model,
                             kWidening * options_.max_epipolar_error_px,
                             static_cast<int>(data.size())));
    Stream stream;
    stream.source = CreateEpipolarHypothesisSource(near, problem_.Range());
    if (stream.source.sample_size == 0) return;
    for (int trial = 0; trial < kNumTrials; ++trial) Try(&stream);
    result_.num_trials += kNumTrials;
    if (!stream.is_optimized) OptimizeBest(&stream);
  }
}

TwoViewCandidate Search::Optimize(const TwoViewModel& start,
                                  FirstRound first_round,
                                  bool with_depth) const {
  TwoViewModel model = start;
  for (size_t k = first_round; k < std::size(kRounds); ++k) {
    const Round& round = kRounds[k];
    TwoViewCostOptions cost_options = problem_.CostOptions(with_depth);
    cost_options.max_epipolar_error_px *= round.widening;
    cost_options.max_depth_residual *= round.widening;
    if (round.capped) cost_options.log_depth_stddev *= problem_.DepthCap();
    TwoViewRefinementOptions refinement_options;
    refinement_options.max_num_iterations = round.max_num_iterations;
    refinement_options.min_relative_decrease = 1e-3;
    const std::vector<int> active = problem_.Active(
        model, cost_options.max_epipolar_error_px, round.max_num_matches);
    RefineModel(Subset(problem_.Data(), active),
                problem_.Range().focal_case,
                cost_options,
                refinement_options,
                &model);
  }
  return problem_.Evaluate(model, with_depth);
}

void Search::Keep(const TwoViewCandidate& candidate) {
  TwoViewCandidate& best =
      candidate.with_depth ? result_.with_depth : result_.without_depth;
  if (candidate.cost < best.cost) best = candidate;
}

double Search::InlierRatio() const {
  const int num_inliers = std::max(result_.with_depth.score.num_inliers,
                                   result_.without_depth.score.num_inliers);
  return static_cast<double>(num_inliers) / problem_.Data().size();
}

// Inliers whose depths are right, too.
double Search::DepthInlierRatio() const {
  if (problem_.NumDepthMatches() == 0) return 0;
  return std::min(InlierRatio(),
                  static_cast<double>(result_.with_depth.num_depth_inliers) /
                      problem_.NumDepthMatches());
}

bool Search::DepthsAreUseful() const {
  return std::isfinite(result_.with_depth.cost) &&
         problem_.DepthsAreEvidence(result_.with_depth.model);
}

bool Search::IsDone(const Stream& stream,
                    double inlier_ratio,
                    double confidence,
                    double margin) const {
  if (stream.source.sample_size == 0) return false;
  const double good = std::pow(inlier_ratio, stream.source.sample_size);
  if (good >= 1) return true;
  return stream.num_trials * std::log1p(-good) <
         margin * std::log1p(-confidence);
}

// Whether both kinds of samples would have found a model of use.
bool Search::IsHopeless() const {
  constexpr double kConfidence = 0.99;
  const double inlier_ratio = std::min(
      1.0,
      static_cast<double>(problem_.MinNumInliers()) / problem_.Data().size());
  const auto is_exhausted = [&](const Stream& stream) {
    return stream.source.sample_size == 0 ||
           IsDone(stream, inlier_ratio, kConfidence, /*margin=*/1);
  };
  return InlierRatio() < inlier_ratio && is_exhausted(depth_) &&
         is_exhausted(epipolar_);
}

}  // namespace

TwoViewSearchResult SearchTwoViewModel(const TwoViewProblem& problem,
                                       SplitMix64* random) {
  return Search(problem, random).Run();
}

}  // namespace dgsfm
