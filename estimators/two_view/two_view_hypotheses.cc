#include "estimators/two_view/two_view_hypotheses.h"

#include "estimators/solvers/epipolar.h"
#include "estimators/solvers/five_points.h"
#include "estimators/solvers/relative_pose_depth.h"
#include "estimators/two_view/two_view_score.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace dgsfm {
namespace {

// Log-normal prior around guessed focal lengths: a factor of 1.6.
constexpr double kLogFocalGuessStddev = 0.5;

// N distinct elements of `from`.
template <size_t N>
std::array<int, N> SampleDistinct(const std::vector<int>& from,
                                  SplitMix64* random) {
  std::array<int, N> sample;
  for (size_t k = 0; k < N; ++k) {
    bool repeated = true;
    while (repeated) {
      sample[k] = from[random->Below(static_cast<int>(from.size()))];
      repeated = std::find(sample.begin(), sample.begin() + k, sample[k]) !=
                 sample.begin() + k;
    }
  }
  return sample;
}

class DepthHypothesisSource : public HypothesisSource {
 public:
  DepthHypothesisSource(const TwoViewData& data,
                        const FocalRange& range,
                        int guess_interval,
                        std::vector<int> candidates)
      : data_(data),
        range_(range),
        guess_interval_(guess_interval),
        candidates_(std::move(candidates)) {}

  int SampleSize() const override { return 3; }

  void Sample(SplitMix64* random,
              std::vector<Hypothesis>* hypotheses) override {
    const std::array<int, 3> sample = SampleDistinct<3>(candidates_, random);
    const bool guess =
        guess_interval_ > 0 && num_samples_++ % guess_interval_ == 0;
    const TwoViewModels models =
        Solve(sample, guess ? FocalCase::KNOWN : range_.focal_case);
    hypotheses->clear();
    for (int i = 0; i < models.count; ++i) {
      if (!range_.Contains(models.values[i])) continue;
      hypotheses->emplace_back();
      hypotheses->back().model = models.values[i];
    }
  }

 private:
  DepthTriplet Triplet(const std::array<int, 3>& sample,
                       double focal1,
                       double focal2) const {
    DepthTriplet triplet;
    for (int k = 0; k < 3; ++k) {
      triplet.points1[k] = data_.points1[sample[k]] / focal1;
      triplet.points2[k] = data_.points2[sample[k]] / focal2;
      triplet.depths1[k] = data_.depths1[sample[k]];
      triplet.depths2[k] = data_.depths2[sample[k]];
    }
    return triplet;
  }

  TwoViewModels Solve(const std::array<int, 3>& sample,
                      FocalCase focal_case) const {
    double unit1 = 1;
    double unit2 = 1;
    TwoViewModels models;
    switch (focal_case) {
      case FocalCase::KNOWN:
        unit1 = range_.guess1;
        unit2 = range_.guess2;
        models = SolveP3PScale(Triplet(sample, unit1, unit2));
        break;
      case FocalCase::SHARED:
        models = SolveSharedFocal(Triplet(sample, 1, 1));
        break;
      case FocalCase::TWO:
        models = SolveTwoFocals(Triplet(sample, 1, 1));
        break;
      case FocalCase::ONE_SIDED1:
        unit1 = range_.guess1;
        models = SolveOneSidedFocal(Triplet(sample, unit1, 1));
        break;
      case FocalCase::ONE_SIDED2:
        unit2 = range_.guess2;
        models = SolveOneSidedFocal(Triplet(sample, 1, unit2).Swapped());
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

  const TwoViewData& data_;
  const FocalRange range_;
  const int guess_interval_;
  const std::vector<int> candidates_;
  int num_samples_ = 0;
};

class EpipolarHypothesisSource : public HypothesisSource {
 public:
  EpipolarHypothesisSource(const TwoViewData& data,
                           const FocalRange& range,
                           std::vector<int> candidates)
      : data_(data),
        range_(range),
        candidates_(std::move(candidates)),
        seven_points_(range.focal_case != FocalCase::KNOWN &&
                      candidates_.size() >= 7) {}

  // With both kinds in turn the guess of the focal lengths is good enough to
  // find the inliers, or it is not: count on the larger sample.
  int SampleSize() const override { return seven_points_ ? 7 : 5; }

  void Sample(SplitMix64* random,
              std::vector<Hypothesis>* hypotheses) override {
    hypotheses->clear();
    if (seven_points_ && num_samples_++ % 2 == 0) {
      SampleSeven(random, hypotheses);
    } else {
      SampleFive(random, hypotheses);
    }
  }

 private:
  void SampleSeven(SplitMix64* random, std::vector<Hypothesis>* hypotheses) {
    const std::array<int, 7> sample = SampleDistinct<7>(candidates_, random);
    std::array<Eigen::Vector2d, 7> points1, points2;
    for (int k = 0; k < 7; ++k) {
      points1[k] = data_.points1[sample[k]] / range_.guess1;
      points2[k] = data_.points2[sample[k]] / range_.guess2;
    }
    const FundamentalMatrices solutions = SolveSevenPoints(points1, points2);
    for (int i = 0; i < solutions.count; ++i) {
      Add(solutions.values[i], /*focals_known=*/false, hypotheses);
    }
  }

  void SampleFive(SplitMix64* random, std::vector<Hypothesis>* hypotheses) {
    const std::array<int, 5> sample = SampleDistinct<5>(candidates_, random);
    std::array<Eigen::Vector2d, 5> points1, points2;
    for (int k = 0; k < 5; ++k) {
      points1[k] = data_.points1[sample[k]] / range_.guess1;
      points2[k] = data_.points2[sample[k]] / range_.guess2;
    }
    const EssentialMatrices solutions = SolveFivePoints(points1, points2);
    for (int i = 0; i < solutions.count; ++i) {
      Add(solutions.values[i], /*focals_known=*/true, hypotheses);
    }
  }

  // F for points divided by the guessed focal lengths.
  void Add(const Eigen::Matrix3d& F,
           bool focals_known,
           std::vector<Hypothesis>* hypotheses) const {
    Hypothesis hypothesis;
    hypothesis.is_fundamental = true;
    hypothesis.fundamental =
        Eigen::Vector3d(1 / range_.guess2, 1 / range_.guess2, 1).asDiagonal() *
        F *
        Eigen::Vector3d(1 / range_.guess1, 1 / range_.guess1, 1).asDiagonal();
    hypothesis.model.focal1 = focals_known ? range_.guess1 : 0;
    hypothesis.model.focal2 = focals_known ? range_.guess2 : 0;
    hypotheses->push_back(hypothesis);
  }

  const TwoViewData& data_;
  const FocalRange range_;
  const std::vector<int> candidates_;
  const bool seven_points_;
  int num_samples_ = 0;
};

// The focal lengths within the range with which F is nearest to an essential
// matrix, on a grid: refinement follows, and a grid has no degenerate cases.
void SearchFocals(const Eigen::Matrix3d& F,
                  const FocalRange& range,
                  double* focal1,
                  double* focal2) {
  constexpr int kNumSteps = 25;
  const auto grid = [](double min, double max, int k) {
    return min * std::pow(max / min, k / (kNumSteps - 1.0));
  };
  const bool unknown1 = range.focal_case != FocalCase::ONE_SIDED1;
  const bool unknown2 = range.focal_case != FocalCase::ONE_SIDED2;
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < (unknown1 ? kNumSteps : 1); ++i) {
    const double f1 = unknown1 ? grid(range.min1, range.max1, i) : range.guess1;
    const bool shared = range.focal_case == FocalCase::SHARED;
    for (int k = 0; k < (unknown2 && !shared ? kNumSteps : 1); ++k) {
      const double f2 = shared     ? f1
                        : unknown2 ? grid(range.min2, range.max2, k)
                                   : range.guess2;
      const double defect = EssentialMatrixDefect(F, f1, f2);
      if (defect < best) {
        best = defect;
        *focal1 = f1;
        *focal2 = f2;
      }
    }
  }
}

// The pose of F that has the most fitting matches in front of the cameras.
TwoViewModel PoseInFront(const Eigen::Matrix3d& F,
                         double focal1,
                         double focal2,
                         const TwoViewData& data,
                         double max_error_px) {
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
    for (int i = 0; i < data.Size(); ++i) {
      if (std::abs(data.Sampson(F, i)) < max_error_px &&
          cheirality(data.points1[i], data.points2[i])) {
        ++num_in_front[k];
      }
    }
  }
  return models[std::max_element(num_in_front.begin(), num_in_front.end()) -
                num_in_front.begin()];
}

}  // namespace

FocalRange FocalRange::Create(const TwoViewDepthInput& input,
                              const TwoViewDepthOptions& options) {
  FocalRange range;
  range.focal_case = input.focal_case;
  const auto set = [&](double focal_length_px,
                       const FocalPrior& given_prior,
                       double image_size_px,
                       bool known,
                       double* guess,
                       double* min,
                       double* max,
                       FocalPrior* prior) {
    const bool has_prior = !known && given_prior.Exists();
    *guess = has_prior ? given_prior.focal_px : focal_length_px;
    *min = options.min_focal_length_ratio * image_size_px;
    *max = options.max_focal_length_ratio * image_size_px;
    if (known) return;
    prior->focal_px = *guess;
    prior->log_stddev =
        has_prior ? given_prior.log_stddev : kLogFocalGuessStddev;
  };
  set(input.focal_length1_px,
      input.focal_prior1,
      input.image_size1_px,
      range.Knows1(),
      &range.guess1,
      &range.min1,
      &range.max1,
      &range.prior1);
  set(input.focal_length2_px,
      input.focal_prior2,
      input.image_size2_px,
      range.Knows2(),
      &range.guess2,
      &range.min2,
      &range.max2,
      &range.prior2);
  if (range.focal_case == FocalCase::SHARED) {
    range.guess1 = range.guess2 = std::sqrt(range.guess1 * range.guess2);
    range.min1 = range.min2 = std::max(range.min1, range.min2);
    range.max1 = range.max2 = std::min(range.max1, range.max2);
    range.prior1.focal_px = range.guess1;
    range.prior2 = FocalPrior();
  }
  return range;
}

bool FocalRange::Contains(const TwoViewModel& model) const {
  return (Knows1() || (model.focal1 >= min1 && model.focal1 <= max1)) &&
         (Knows2() || (model.focal2 >= min2 && model.focal2 <= max2));
}

std::unique_ptr<HypothesisSource> CreateDepthHypothesisSource(
    const TwoViewData& data, const FocalRange& range, int guess_interval) {
  std::vector<int> candidates;
  for (int i = 0; i < data.Size(); ++i) {
    if (data.HasDepths(i)) candidates.push_back(i);
  }
  if (candidates.size() < 3) return nullptr;
  return std::make_unique<DepthHypothesisSource>(
      data, range, guess_interval, std::move(candidates));
}

std::unique_ptr<HypothesisSource> CreateEpipolarHypothesisSource(
    const TwoViewData& data, const FocalRange& range) {
  if (data.Size() < 5) return nullptr;
  std::vector<int> candidates(data.Size());
  for (int i = 0; i < data.Size(); ++i) candidates[i] = i;
  return std::make_unique<EpipolarHypothesisSource>(
      data, range, std::move(candidates));
}

std::vector<TwoViewModel> ExpandHypothesis(const Hypothesis& hypothesis,
                                           const TwoViewData& data,
                                           const FocalRange& range,
                                           double max_error_px) {
  if (!hypothesis.is_fundamental) return {hypothesis.model};
  const auto pose = [&](double focal1, double focal2) {
    return PoseInFront(
        hypothesis.fundamental, focal1, focal2, data, max_error_px);
  };
  std::vector<TwoViewModel> models;
  if (hypothesis.model.focal1 > 0) {
    models.push_back(pose(hypothesis.model.focal1, hypothesis.model.focal2));
  } else {
    double focal1 = range.guess1;
    double focal2 = range.guess2;
    SearchFocals(hypothesis.fundamental, range, &focal1, &focal2);
    models.push_back(pose(focal1, focal2));
    models.push_back(pose(range.guess1, range.guess2));
  }
  models.erase(std::remove_if(
                   models.begin(),
                   models.end(),
                   [](const TwoViewModel& model) { return !model.IsFinite(); }),
               models.end());
  return models;
}

}  // namespace dgsfm
