// Where the robust estimator of two_view_geometry_depth.h takes its models
// from: random minimal samples, with or without depth.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_data.h"
#include "estimators/two_view/two_view_geometry_depth.h"
#include "estimators/two_view/two_view_model.h"

#include <functional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Plausible focal lengths of an image.
struct FocalBounds {
  // Known focal lengths are the guess and are not questioned.
  bool is_known = false;
  double guess_px = 0;
  double min_px = 0;
  double max_px = 0;
  // Exists for unknown focal lengths.
  FocalPrior prior;

  bool Contains(double focal_px) const {
    return is_known || (focal_px >= min_px && focal_px <= max_px);
  }
};

// Plausible focal lengths of an image pair, and which of them are unknown.
struct FocalRange {
  FocalCase focal_case = FocalCase::TWO;
  // Equal but for the prior, which view 1 has alone, if the focal length is
  // shared.
  FocalBounds view1, view2;

  static FocalRange Create(const TwoViewDepthInput& input,
                           const TwoViewDepthOptions& options);
  bool Contains(const TwoViewModel& model) const {
    return view1.Contains(model.focal1) && view2.Contains(model.focal2);
  }
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

struct HypothesisSource {
  // Number of matches that have to be inliers for a sample to be good; 0 if
  // there are too few matches for a sample.
  int sample_size = 0;
  // Hypotheses of the next random sample.
  std::function<std::vector<Hypothesis>(SplitMix64*)> sample;
};

// Three matches with depth. One sample in `guess_interval` keeps the guessed
// focal lengths, none with 0. The source refers to the data.
HypothesisSource CreateDepthHypothesisSource(const TwoViewData& data,
                                             const FocalRange& range,
                                             int guess_interval);

// Five matches with the known or guessed focal lengths; with unknown ones in
// turn with seven matches. The source refers to the data.
HypothesisSource CreateEpipolarHypothesisSource(const TwoViewData& data,
                                                const FocalRange& range);

// Translations of two matches with this rotation and the known or guessed
// focal lengths. The source refers to the data.
HypothesisSource CreateTranslationHypothesisSource(
    const TwoViewData& data,
    const FocalRange& range,
    const Eigen::Quaterniond& rotation);

// The models a hypothesis stands for, in front of both cameras for most of the
// matches that fit it, focal lengths within their range. Of a fundamental
// matrix with unknown focal lengths: with those that come nearest to an
// essential matrix, and with the guessed ones.
std::vector<TwoViewModel> ExpandHypothesis(const Hypothesis& hypothesis,
                                           const TwoViewData& data,
                                           const FocalRange& range,
                                           double max_error_px);

}  // namespace dgsfm
