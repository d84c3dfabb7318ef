#include "estimators/two_view/two_view_hypotheses.h"

#include "estimators/rotation_vector.h"
#include "estimators/solvers/epipolar.h"
#include "estimators/solvers/five_points.h"
#include "estimators/solvers/relative_pose_depth.h"
#include "estimators/two_view/two_view_score.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <type_traits>
#include <utility>

namespace dgsfm {
namespace {

// N distinct numbers below `bound`.
template <size_t N>
std::array<int, N> SampleDistinct(int bound, SplitMix64* random) {
  std::array<int, N> sample;
  for (size_t k = 0; k < N; ++k) {
    do {
      sample[k] = random->Below(bound);
    } while (std::find(sample.begin(), sample.begin() + k, sample[k]) !=
             sample.begin() + k);
  }
  return sample;
}

Eigen::Matrix3d InverseCalibration(double focal) {
  return Eigen::Vector3d(1 / focal, 1 / focal, 1).asDiagonal();
}

// Points are divided by known focal lengths, which the solvers take as one.
TwoViewModels SolveDepthTriplet(const std::array<TwoViewMatch, 3>& sample,
                                const FocalRange& range) {
  const double unit1 = range.view1.is_known ? range.view1.guess_px : 1;
  const double unit2 = range.view2.is_known ? range.view2.guess_px : 1;
  DepthTriplet triplet;
  for (int k = 0; k < 3; ++k) {
    triplet.points1[k] = sample[k].x1 / unit1;
    triplet.points2[k] = sample[k].x2 / unit2;
    triplet.depths1[k] = sample[k].depth1;
    triplet.depths2[k] = sample[k].depth2;
  }
  TwoViewModels models;
  switch (range.focal_case) {
    case FocalCase::KNOWN:
      models = SolveP3PScale(triplet);
      break;
    case FocalCase::SHARED:
      models = SolveSharedFocal(triplet);
      break;
    case FocalCase::TWO:
      models = SolveTwoFocals(triplet);
      break;
    case FocalCase::ONE_SIDED1:
      models = SolveOneSidedFocal(triplet);
      break;
    case FocalCase::ONE_SIDED2:
      models = SolveOneSidedFocal(triplet.Swapped());
      for (int i = 0; i < models.count; ++i) {
        models.values[i] = models.values[i].Inverse();
      }
      break;
  }
  for (int i = 0; i < models.count; ++i) {
    models.values[i].focal1 *= unit1;
    models.values[i].focal2 *= unit2;
  }
  return models;
}

// Fundamental matrices of random samples of five or seven matches, which are
// solved eight at a time. Those of five have the guessed focal lengths.
template <size_t N>
class EpipolarSamples {
 public:
  EpipolarSamples(const TwoViewData& data, const FocalRange& range)
      : data_(data),
        guess1_px_(range.view1.guess_px),
        guess2_px_(range.view2.guess_px) {}

  // Hypotheses of the next sample.
  std::vector<Hypothesis> Next(SplitMix64* random) {
    if (next_ == kNumLanes) {
      Solve(random);
      next_ = 0;
    }
    const Solutions& solutions = solutions_[next_++];
    std::vector<Hypothesis> hypotheses(solutions.count);
    for (int i = 0; i < solutions.count; ++i) {
      Hypothesis& hypothesis = hypotheses[i];
      hypothesis.is_fundamental = true;
      hypothesis.fundamental = InverseCalibration(guess2_px_) *
                               solutions.values[i] *
                               InverseCalibration(guess1_px_);
      hypothesis.model.focal1 = N == 5 ? guess1_px_ : 0;
      hypothesis.model.focal2 = N == 5 ? guess2_px_ : 0;
    }
    return hypotheses;
  }

 private:
  using Solutions =
      std::conditional_t<N == 5, EssentialMatrices, FundamentalMatrices>;

  void Solve(SplitMix64* random) {
    SampleLanes<N> samples;
    for (int lane = 0; lane < kNumLanes; ++lane) {
      const std::array<int, N> sample =
          SampleDistinct<N>(static_cast<int>(data_.size()), random);
      for (size_t k = 0; k < N; ++k) {
        const TwoViewMatch& match = data_[sample[k]];
        samples.Set(k, lane, match.x1 / guess1_px_, match.x2 / guess2_px_);
      }
    }
    if constexpr (N == 5) {
      solutions_ = SolveFivePoints(samples);
    } else {
      solutions_ = SolveSevenPoints(samples);
    }
  }

  const TwoViewData& data_;
  const double guess1_px_, guess2_px_;
  std::array<Solutions, kNumLanes> solutions_;
  int next_ = kNumLanes;
};

// Even in the logarithm: errors of focal lengths matter as ratios.
std::vector<double> FocalGrid(const FocalBounds& bounds) {
  constexpr int kNumSteps = 25;
  if (bounds.is_known) return {bounds.guess_px};
  std::vector<double> grid;
  for (int k = 0; k < kNumSteps; ++k) {
    grid.push_back(bounds.min_px * std::pow(bounds.max_px / bounds.min_px,
                                            k / (kNumSteps - 1.0)));
  }
  return grid;
}

// The focal lengths within the range with which F is nearest to an essential
// matrix, on a grid: refinement follows, and a grid has no degenerate cases.
std::pair<double, double> SearchFocals(const Eigen::Matrix3d& F,
                                       const FocalRange& range) {
  const std::vector<double> grid1 = FocalGrid(range.view1);
  const std::vector<double> grid2 = FocalGrid(range.view2);
  double best_defect = std::numeric_limits<double>::infinity();
  std::pair<double, double> best(range.view1.guess_px, range.view2.guess_px);
  for (const double focal1 : grid1) {
    for (double focal2 : grid2) {
      if (range.focal_case == FocalCase::SHARED) focal2 = focal1;
      const double defect = EssentialMatrixDefect(F, focal1, focal2);
      if (defect < best_defect) {
        best_defect = defect;
        best = {focal1, focal2};
      }
      if (range.focal_case == FocalCase::SHARED) break;
    }
  }
  return best;
}

// The pose of F that has the most fitting matches in front of the cameras.
TwoViewModel PoseInFront(const Eigen::Matrix3d& F,
                         double focal1,
                         double focal2,
                         const TwoViewData& data,
                         double max_error_px) {
  // Enough to tell the poses apart.
  constexpr size_t kMaxNumMatches = 100;
  TwoViewData fitting;
  for (const TwoViewMatch& match : data) {
    if (fitting.size() == kMaxNumMatches) break;
    if (std::abs(match.Sampson(F)) < max_error_px) fitting.push_back(match);
  }
  // The other three poses have the scene behind a camera.
  const EssentialPoses poses = DecomposeEssentialMatrix(
      Eigen::Vector3d(focal2, focal2, 1).asDiagonal() * F *
      Eigen::Vector3d(focal1, focal1, 1).asDiagonal());
  std::array<TwoViewModel, 4> models;
  std::array<int, 4> num_in_front{};
  for (int k = 0; k < 4; ++k) {
    models[k].rotation = poses.rotations[k / 2];
    models[k].translation = (k % 2 ? -1 : 1) * poses.translation;
    models[k].focal1 = focal1;
    models[k].focal2 = focal2;
    const Cheirality cheirality(models[k], max_error_px);
    for (const TwoViewMatch& match : fitting) {
      num_in_front[k] += cheirality(match.x1, match.x2);
    }
  }
  return models[std::max_element(num_in_front.begin(), num_in_front.end()) -
                num_in_front.begin()];
}

FocalBounds CreateBounds(bool is_known,
                         double focal_length_px,
                         const FocalPrior& prior,
                         double image_size_px,
                         const TwoViewDepthOptions& options) {
  // Log-normal prior around guessed focal lengths: a factor of 1.6.
  constexpr double kLogFocalGuessStddev = 0.5;
  FocalBounds bounds;
  bounds.is_known = is_known;
  bounds.guess_px = focal_length_px;
  bounds.min_px = options.min_focal_length_ratio * image_size_px;
  bounds.max_px = options.max_focal_length_ratio * image_size_px;
  if (is_known) return bounds;
  bounds.prior = prior.Exists()
                     ? prior
                     : FocalPrior{focal_length_px, kLogFocalGuessStddev};
  bounds.guess_px = bounds.prior.focal_px;
  return bounds;
}

}  // namespace

FocalRange FocalRange::Create(const TwoViewDepthInput& input,
                              const TwoViewDepthOptions& options) {
  FocalRange range;
  range.focal_case = input.focal_case;
  range.view1 = CreateBounds(input.focal_case == FocalCase::KNOWN ||
                                 input.focal_case == FocalCase::ONE_SIDED1,
                             input.focal_length1_px,
                             input.focal_prior1,
                             input.image_size1_px,
                             options);
  range.view2 = CreateBounds(input.focal_case == FocalCase::KNOWN ||
                                 input.focal_case == FocalCase::ONE_SIDED2,
                             input.focal_length2_px,
                             input.focal_prior2,
                             input.image_size2_px,
                             options);
  if (range.focal_case == FocalCase::SHARED) {
    // The prior may count once only.
    FocalBounds& shared = range.view1;
    shared.guess_px = std::sqrt(shared.guess_px * range.view2.guess_px);
    shared.min_px = std::max(shared.min_px, range.view2.min_px);
    shared.max_px = std::min(shared.max_px, range.view2.max_px);
    shared.prior.focal_px = shared.guess_px;
    range.view2 = shared;
    range.view2.prior = FocalPrior();
  }
  return range;
}

HypothesisSource CreateDepthHypothesisSource(const TwoViewData& data,
                                             const FocalRange& range,
                                             int guess_interval) {
  std::vector<int> candidates;
  for (size_t i = 0; i < data.size(); ++i) {
    if (data[i].HasDepths()) candidates.push_back(static_cast<int>(i));
  }
  if (candidates.size() < 3) return {};
  FocalRange guessed = range;
  guessed.focal_case = FocalCase::KNOWN;
  guessed.view1.is_known = guessed.view2.is_known = true;
  const auto sample =
      [&data, range, guessed, guess_interval, candidates, count = 0](
          SplitMix64* random) mutable {
        const bool guess = guess_interval > 0 && count++ % guess_interval == 0;
        const std::array<int, 3> indices =
            SampleDistinct<3>(static_cast<int>(candidates.size()), random);
        const TwoViewModels models =
            SolveDepthTriplet({data[candidates[indices[0]]],
                               data[candidates[indices[1]]],
                               data[candidates[indices[2]]]},
                              guess ? guessed : range);
        std::vector<Hypothesis> hypotheses;
        for (int i = 0; i < models.count; ++i) {
          if (!range.Contains(models.values[i])) continue;
          hypotheses.emplace_back();
          hypotheses.back().model = models.values[i];
        }
        return hypotheses;
      };
  return {3, sample};
}

HypothesisSource CreateEpipolarHypothesisSource(const TwoViewData& data,
                                                const FocalRange& range) {
  if (data.size() < 5) return {};
  const bool seven = range.focal_case != FocalCase::KNOWN && data.size() >= 7;
  const auto sample = [seven,
                       fives = EpipolarSamples<5>(data, range),
                       sevens = EpipolarSamples<7>(data, range),
                       count = 0](SplitMix64* random) mutable {
    return seven && count++ % 2 == 0 ? sevens.Next(random) : fives.Next(random);
  };
  // With both kinds in turn the guess of the focal lengths is good enough to
  // find the inliers, or it is not: the larger sample counts.
  return {seven ? 7 : 5, sample};
}

HypothesisSource CreateTranslationHypothesisSource(
    const TwoViewData& data,
    const FocalRange& range,
    const Eigen::Quaterniond& rotation) {
  if (data.size() < 2) return {};
  const Eigen::Matrix3d inverse_calibration1 =
      InverseCalibration(range.view1.guess_px);
  const Eigen::Matrix3d inverse_calibration2 =
      InverseCalibration(range.view2.guess_px);
  const Eigen::Matrix3d R = rotation.toRotationMatrix();
  // The translation is orthogonal to the normals of both epipolar planes.
  const auto sample = [=, &data, &range](SplitMix64* random) {
    Eigen::Vector3d normals[2];
    const auto indices =
        SampleDistinct<2>(static_cast<int>(data.size()), random);
    for (int k = 0; k < 2; ++k) {
      const TwoViewMatch& match = data[indices[k]];
      normals[k] =
          (inverse_calibration2 * match.x2.homogeneous())
              .cross(R * inverse_calibration1 * match.x1.homogeneous());
    }
    const Eigen::Vector3d translation = normals[0].cross(normals[1]);
    if (!(translation.norm() > 0)) return std::vector<Hypothesis>();
    Hypothesis hypothesis;
    hypothesis.is_fundamental = true;
    hypothesis.fundamental = inverse_calibration2 *
                             CrossMatrix(translation.normalized()) * R *
                             inverse_calibration1;
    hypothesis.model.focal1 = range.view1.guess_px;
    hypothesis.model.focal2 = range.view2.guess_px;
    return std::vector<Hypothesis>{hypothesis};
  };
  return {2, sample};
}

std::vector<TwoViewModel> ExpandHypothesis(const Hypothesis& hypothesis,
                                           const TwoViewData& data,
                                           const FocalRange& range,
                                           double max_error_px) {
  if (!hypothesis.is_fundamental) return {hypothesis.model};
  std::vector<TwoViewModel> models;
  const auto add = [&](double focal1, double focal2) {
    const TwoViewModel model =
        PoseInFront(hypothesis.fundamental, focal1, focal2, data, max_error_px);
    if (model.IsFinite()) models.push_back(model);
  };
  if (hypothesis.model.focal1 > 0) {
    add(hypothesis.model.focal1, hypothesis.model.focal2);
  } else {
    const auto [focal1, focal2] = SearchFocals(hypothesis.fundamental, range);
    add(focal1, focal2);
    add(range.view1.guess_px, range.view2.guess_px);
  }
  return models;
}

}  // namespace dgsfm
