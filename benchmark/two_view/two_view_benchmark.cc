// Time of minimal solvers, scoring, refinement and whole pairs. The solvers
// also report the share of 100 000 random exact problems whose truth they find
// within 1e-6 ("found") and their median error.

#include "estimators/solvers/epipolar.h"
#include "estimators/solvers/five_points.h"
#include "estimators/two_view/two_view_problem.h"
#include "tests/estimators/depth_problems.h"
#include "tests/estimators/two_view_scene.h"

#include <algorithm>
#include <array>
#include <vector>

#include <benchmark/benchmark.h>

namespace dgsfm {
namespace {

constexpr int kNumProblems = 100000;

template <typename Create, typename Solve>
void RunSolver(benchmark::State& state,
               const Create& create,
               const Solve& solve) {
  std::mt19937_64 random(1);
  std::vector<decltype(create(&random))> problems;
  std::vector<double> errors;
  int num_found = 0;
  for (int k = 0; k < kNumProblems; ++k) {
    problems.push_back(create(&random));
    errors.push_back(
        BestDistance(solve(problems.back()), problems.back().truth));
    num_found += errors.back() < 1e-6;
  }
  std::nth_element(
      errors.begin(), errors.begin() + kNumProblems / 2, errors.end());
  state.counters["found"] = static_cast<double>(num_found) / kNumProblems;
  state.counters["median"] = errors[kNumProblems / 2];
  size_t k = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(solve(problems[k]));
    k = (k + 1) % kNumProblems;
  }
}

template <typename Solve>
void RunTripletSolver(benchmark::State& state,
                      Focals focals,
                      const Solve& solve) {
  RunSolver(
      state,
      [focals](std::mt19937_64* random) {
        return CreateDepthProblem(focals, random);
      },
      [&solve](const DepthProblem& problem) { return solve(problem.triplet); });
}

void P3PScale(benchmark::State& state) {
  RunTripletSolver(state, Focals::KNOWN, SolveP3PScale);
}
BENCHMARK(P3PScale);

void OneSidedFocal(benchmark::State& state) {
  RunTripletSolver(state, Focals::ONE_SIDED, SolveOneSidedFocal);
}
BENCHMARK(OneSidedFocal);

void SharedFocal(benchmark::State& state) {
  RunTripletSolver(state, Focals::SHARED, SolveSharedFocal);
}
BENCHMARK(SharedFocal);

void TwoFocals(benchmark::State& state) {
  RunTripletSolver(state, Focals::TWO, SolveTwoFocals);
}
BENCHMARK(TwoFocals);

// Times are those of eight samples.
template <size_t N, class Solver>
void RunEpipolarSolver(benchmark::State& state, const Solver& solver) {
  const TwoViewScene scene = CreateTwoViewScene({}, FocalCase::KNOWN, 1);
  const DepthMatches& matches = scene.input.matches;
  SplitMix64 random(1);
  for (auto _ : state) {
    SampleLanes<N> samples;
    for (int lane = 0; lane < kNumLanes; ++lane) {
      for (size_t k = 0; k < N; ++k) {
        const int i = random.Below(static_cast<int>(matches.points1.size()));
        samples.Set(k,
                    lane,
                    matches.points1[i] / scene.truth.focal1,
                    matches.points2[i] / scene.truth.focal2);
      }
    }
    benchmark::DoNotOptimize(solver(samples));
  }
}

void FivePoints(benchmark::State& state) {
  RunEpipolarSolver<5>(state, SolveFivePoints);
}
BENCHMARK(FivePoints);

void SevenPoints(benchmark::State& state) {
  RunEpipolarSolver<7>(state, SolveSevenPoints);
}
BENCHMARK(SevenPoints);

TwoViewDepthOptions NoisyOptions() {
  TwoViewDepthOptions options;
  options.max_epipolar_error_px = 2;
  return options;
}

TwoViewScene CreateScene(int num_matches, uint64_t seed) {
  TwoViewSceneOptions options;
  options.num_matches = num_matches;
  options.outlier_ratio = 0.6;
  return CreateTwoViewScene(options, FocalCase::TWO, seed);
}

void Score(benchmark::State& state) {
  const TwoViewDepthOptions options = NoisyOptions();
  const TwoViewScene scene = CreateScene(static_cast<int>(state.range(0)), 1);
  SplitMix64 random(1);
  const TwoViewProblem problem(scene.input, options, &random);
  for (auto _ : state) {
    benchmark::DoNotOptimize(problem.Scorer().Score(scene.truth));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(Score)->Arg(400)->Arg(2000);

// Samples without depth are scored by their fundamental matrices.
void ScoreFundamental(benchmark::State& state) {
  const TwoViewDepthOptions options = NoisyOptions();
  const TwoViewScene scene = CreateScene(static_cast<int>(state.range(0)), 1);
  SplitMix64 random(1);
  const TwoViewProblem problem(scene.input, options, &random);
  const Eigen::Matrix3d F = scene.truth.FundamentalMatrix();
  for (auto _ : state) {
    benchmark::DoNotOptimize(problem.Scorer().Score(F));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(ScoreFundamental)->Arg(400)->Arg(2000);

// A step of least squares on the inliers with smooth depth errors.
void RefineStep(benchmark::State& state) {
  const TwoViewDepthOptions options = NoisyOptions();
  const TwoViewScene scene = CreateScene(static_cast<int>(state.range(0)), 1);
  SplitMix64 random(1);
  const TwoViewProblem problem(scene.input, options, &random);
  const TwoViewData data = Subset(problem.Data(), problem.Inliers(scene.truth));
  TwoViewCostOptions cost_options = problem.CostOptions(/*with_depth=*/true);
  cost_options.depth_field_stddev = 0.05;
  TwoViewRefinementOptions refinement_options;
  refinement_options.max_num_iterations = 1;
  for (auto _ : state) {
    TwoViewModel model = scene.truth;
    benchmark::DoNotOptimize(RefineModel(
        data, FocalCase::TWO, cost_options, refinement_options, &model));
  }
  state.SetItemsProcessed(state.iterations() * data.size());
}
BENCHMARK(RefineStep)->Arg(400)->Arg(2000)->Unit(benchmark::kMicrosecond);

void Pair(benchmark::State& state) {
  constexpr int kNumScenes = 50;
  std::vector<TwoViewScene> scenes;
  for (int k = 0; k < kNumScenes; ++k) {
    scenes.push_back(CreateScene(static_cast<int>(state.range(0)), k));
  }
  size_t k = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        EstimateTwoViewGeometryWithDepth(scenes[k].input, NoisyOptions()));
    k = (k + 1) % kNumScenes;
  }
}
BENCHMARK(Pair)->Arg(400)->Arg(2000)->Arg(10000)->Iterations(50)->Unit(
    benchmark::kMillisecond);

}  // namespace
}  // namespace dgsfm

BENCHMARK_MAIN();
