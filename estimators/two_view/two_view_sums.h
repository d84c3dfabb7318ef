// The terms of a TwoViewCostFunction, summed over the matches of a pair eight
// at a time.

#pragma once

#include "estimators/lanes.h"
#include "estimators/two_view/two_view_depth_field.h"
#include "estimators/two_view/two_view_lanes.h"
#include "estimators/two_view/two_view_model.h"
#include "estimators/two_view/two_view_residuals.h"

#include <vector>

namespace dgsfm {

enum class TwoViewLoss {
  TRUNCATED_SQUARES,
  // Cauchy's loss up to the truncation, constant beyond.
  TRUNCATED_CAUCHY,
  // Cauchy's loss with the truncation as its scale.
  CAUCHY,
};

struct TwoViewLossOptions {
  TwoViewLoss loss;
  // Square of the truncation, in the unit of the squares.
  double max_sq_error;
};

// The parameters of the model, then those of the depth fields.
constexpr int kNumCostParams = kNumTwoViewParams + 2 * kNumDepthFieldTerms;

// Sums of w J^T J, lower triangle, and of w J^T r.
template <int kSize>
struct LaneEquations {
  Lanes matrix[kSize * (kSize + 1) / 2] = {};
  Lanes gradient[kSize] = {};
};

// Sampson errors, in units of `stddev_px`. The equations, if not null, are by
// the entries of the fundamental matrix (column-major). Returns the cost.
double SumSampsonErrors(const std::vector<MatchLanes>& matches,
                        const TwoViewModel& model,
                        double stddev_px,
                        const TwoViewLossOptions& loss,
                        LaneEquations<9>* equations);

struct DepthSum {
  double cost = 0;
  // Matches whose residual is not truncated.
  int num_inliers = 0;
};

// Forward transfer errors times `weight`. Points behind camera 2 cost nothing.
DepthSum SumTransferErrors(const std::vector<MatchLanes>& matches,
                           const TwoViewModel& model,
                           double weight,
                           const TwoViewLossOptions& loss,
                           LaneEquations<kNumTwoViewParams>* equations);

// Whitened transfer errors. With `whiten`, whitens them at this model first.
// Points behind camera 2 cost the truncation. The equations are those of the
// model alone, or of the model and the fields.
template <int kSize>
DepthSum SumWhitenedErrors(const std::vector<MatchLanes>& matches,
                           const TwoViewModel& model,
                           const DepthFields& fields,
                           const WhiteningOptions& options,
                           const TwoViewLossOptions& loss,
                           bool whiten,
                           std::vector<WhiteningLanes>* whitenings,
                           LaneEquations<kSize>* equations);

}  // namespace dgsfm
