// Where the robust estimator of two_view_geometry_depth.h takes its models
// from: random minimal samples, with or without depth.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_cost.h"
#include "estimators/two_view/two_view_data.h"
#include "estimators/two_view/two_view_geometry_depth.h"
#include "estimators/two_view/two_view_model.h"

#include <memory>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Plausible focal lengths of an image pair, and which of them are unknown.
struct FocalRange {
  FocalCase focal_case = FocalCase::TWO;
  double guess1 = 0;
  double guess2 = 0;
  double min1 = 0, max1 = 0;
  double min2 = 0, max2 = 0;
  // On unknown focal lengths; one for both where they are shared.
  FocalPrior prior1, prior2;

  static FocalRange Create(const TwoViewDepthInput& input,
                           const TwoViewDepthOptions& options);
  bool Knows1() const {
    return focal_case == FocalCase::KNOWN ||
           focal_case == FocalCase::ONE_SIDED1;
  }
  bool Knows2() const {
    return focal_case == FocalCase::KNOWN ||
           focal_case == FocalCase::ONE_SIDED2;
  }
  // Known focal lengths are not questioned.
  bool Contains(const TwoViewModel& model) const;
};

// A model that is cheap to score. Minimal samples without depth give a
// fundamental matrix, which stands for several poses (and focal lengths):
// they are worked out only for those that score well.
struct Hypothesis {
  bool is_fundamental = false;
  Eigen::Matrix3d fundamental;
  // With is_fundamental only the focal lengths, 0 = unknown.
  TwoViewModel model;
};

class HypothesisSource {
 public:
  virtual ~HypothesisSource() = default;

  // Hypotheses of the next random sample.
  virtual void Sample(SplitMix64* random,
                      std::vector<Hypothesis>* hypotheses) = 0;
  // Number of matches that have to be inliers for a sample to be good.
  virtual int SampleSize() const = 0;
};

// Three matches with depth. One sample in `guess_interval` keeps the guessed
// focal lengths, none with 0. Nothing if less than three matches have depth.
std::unique_ptr<HypothesisSource> CreateDepthHypothesisSource(
    const TwoViewData& data, const FocalRange& range, int guess_interval);

// Five matches with the known or guessed focal lengths; with unknown ones in
// turn with seven matches. Nothing if there are less matches than that.
std::unique_ptr<HypothesisSource> CreateEpipolarHypothesisSource(
    const TwoViewData& data, const FocalRange& range);

// The models a hypothesis stands for, in front of both cameras for most of the
// matches that fit it, focal lengths within their range. Of a fundamental
// matrix with unknown focal lengths: with those that come nearest to an
// essential matrix, and with the guessed ones.
std::vector<TwoViewModel> ExpandHypothesis(const Hypothesis& hypothesis,
                                           const TwoViewData& data,
                                           const FocalRange& range,
                                           double max_error_px);

}  // namespace dgsfm
