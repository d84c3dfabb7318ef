// What search and final refinement of two_view_geometry_depth.h share: the
// matches of a pair in random order, and how its models compare.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_cost.h"
#include "estimators/two_view/two_view_geometry_depth.h"
#include "estimators/two_view/two_view_hypotheses.h"
#include "estimators/two_view/two_view_refinement.h"
#include "estimators/two_view/two_view_score.h"

#include <limits>
#include <optional>
#include <vector>

namespace dgsfm {

// Depth errors of a network vary slowly over an image: a pair has no more than
// about this many independent ones, however many matches there are.
constexpr double kNumIndependentDepths = 10;

struct TwoViewCandidate {
  TwoViewModel model;
  bool with_depth = false;
  TwoViewScore score;
  // By which candidates compare: the score, and what the depths say.
  double cost = std::numeric_limits<double>::infinity();
  int num_depth_inliers = 0;
};

// Logs of the transferred over the given depths of these matches, those without
// depths left out.
std::vector<double> LogDepthRatios(const TwoViewData& data,
                                   const std::vector<int>& indices,
                                   const TwoViewModel& model);
// Standard deviation of the log depth of one map by such ratios; zero without.
double DepthNoise(const std::vector<double>& log_ratios);

// Keeps a reference to the options.
class TwoViewProblem {
 public:
  TwoViewProblem(const TwoViewDepthInput& input,
                 const TwoViewDepthOptions& options,
                 SplitMix64* random);
  // Searches refer to the data.
  TwoViewProblem(const TwoViewProblem&) = delete;
  TwoViewProblem& operator=(const TwoViewProblem&) = delete;

  const TwoViewDepthOptions& Options() const { return options_; }
  const FocalRange& Range() const { return range_; }
  const TwoViewData& Data() const { return data_; }
  const TwoViewScorer& Scorer() const { return scorer_; }
  // Match of an index of Data().
  int MatchIdx(int i) const { return order_[i]; }
  int NumDepthMatches() const { return num_depth_matches_; }
  const std::optional<Eigen::Quaterniond>& Rotation() const {
    return rotation_;
  }
  int MinNumInliers() const { return min_num_inliers_; }

  TwoViewCostOptions CostOptions(bool with_depth) const;
  // Factor of the depth noise with which all matches tell as much as the
  // independent ones.
  double DepthCap() const;

  TwoViewCandidate Evaluate(const TwoViewModel& model, bool with_depth) const;

  // Indices of the first `max_num` matches with a Sampson error below
  // `max_error_px`, in front of both cameras or not.
  std::vector<int> Near(const TwoViewModel& model,
                        double max_error_px,
                        int max_num) const;
  // The same for matches that may come within `max_error_px` as the model
  // changes.
  std::vector<int> Active(const TwoViewModel& model,
                          double max_error_px,
                          int max_num) const;
  std::vector<int> Inliers(const TwoViewModel& model) const;

  // Whether the depths agree with the model better than those of other points
  // would: not if their noise is large.
  bool DepthsAreEvidence(const TwoViewModel& model) const;

  // Scales a model without depth by the medians of its triangulated depths
  // over those of the maps. False, and the model as it was, if they are few or
  // disagree. The first `max_num_matches` inliers decide.
  bool AttachScale(TwoViewModel* model,
                   int max_num_matches = std::numeric_limits<int>::max()) const;

 private:
  const TwoViewDepthOptions& options_;
  const FocalRange range_;
  // Half of the larger image sides [px].
  const double image_unit1_px_;
  const double image_unit2_px_;
  const std::optional<Eigen::Quaterniond> rotation_;
  const int min_num_inliers_;
  std::vector<int> order_;
  const TwoViewData data_;
  const TwoViewScorer scorer_;
  int num_depth_matches_ = 0;
};

}  // namespace dgsfm
