// The shift of a map that is disparity or depth up to scale and shift, from the
// depths that pairs of its image triangulate.
//
// Model: at place i of pair p the value of the map is
//   v_i = a_p x_pi + b + e_i,
// where x is the inverse depth (of disparity) or the depth in the unit of the
// pair, a_p > 0 is the scale of each pair, and b is the shift of the map.
// Errors e are relative to v - b, as those of depth are, and a small part of
// the range of the map besides. Errors of maps are smooth: a pair counts as few
// independent places. Errors of relative poses and focal lengths bend x by
// pair, so that shifts of pairs spread more than their places do; their spread
// is part of the result's.

#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace dgsfm {

// A place of the map.
struct AffineDepthSample {
  double value = 0;
  // Inverse depth or depth, positive.
  double predictor = 0;
};

struct AffineDepthFitOptions {
  // Pairs with fewer places fit nothing.
  int min_num_samples = 15;
  // Maps that fit worse are not used: standard deviation of the errors over
  // v - b [1].
  double max_noise = 0.35;
  // Maps whose shift is less certain are not used: its standard deviation over
  // the median of v - b, which is the relative error of the median depth [1].
  double max_shift_error = 0.2;

  bool IsValid(std::string* error) const;
};

struct AffineDepthFit {
  // Whether the shift can be used; what else has a meaning is then set.
  bool success = false;
  // Otherwise, why not.
  std::string reason;
  double shift = 0;
  double shift_stddev = 0;
  // Standard deviation of errors over v - b [1].
  double noise = 0;
  // Scale of each pair and its standard deviation; 0 of those that were not
  // used.
  std::vector<double> scales;
  std::vector<double> scale_stddevs;
  size_t num_samples = 0;
  size_t num_pairs = 0;
  // How values and predictors go together, over all pairs: 1 if the larger
  // value always has the larger predictor, -1 if it never has, 0 if they are
  // unrelated. Also without success.
  double concordance = 0;
};

// Throws std::invalid_argument for numbers that are not finite and predictors
// that are not positive.
AffineDepthFit FitAffineDepth(
    const std::vector<std::vector<AffineDepthSample>>& pairs,
    const AffineDepthFitOptions& options);

// The share of pairs of places whose larger value has the larger predictor,
// minus the share of the others, for places half of the sample apart by rank; 0
// for fewer than two.
double Concordance(std::vector<AffineDepthSample> samples);

}  // namespace dgsfm
