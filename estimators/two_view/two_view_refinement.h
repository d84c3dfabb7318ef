// Least squares over the unknown parameters of a TwoViewModel.

#pragma once

#include "estimators/two_view/two_view_cost.h"
#include "estimators/two_view/two_view_geometry_depth.h"

namespace dgsfm {

struct TwoViewRefinementOptions {
  int max_num_iterations = 50;
  // Ends when a step lowers the cost by a smaller share.
  double min_relative_decrease = 1e-5;
};

// Levenberg-Marquardt over the parameters that are unknown in `focal_case`.
// Whitening follows the model from step to step. Returns the cost of the
// result, never above that of the start. A model or step that is not finite
// leaves the model as it was. With depth fields in the cost, `fields` are their
// start and result (null: start at zero).
TwoViewCost RefineModel(const TwoViewData& data,
                        FocalCase focal_case,
                        const TwoViewCostOptions& cost_options,
                        const TwoViewRefinementOptions& options,
                        TwoViewModel* model,
                        DepthFields* fields = nullptr);

// Inverse of the Gauss-Newton matrix, depth fields marginalised: zero in the
// rows of known parameters, huge on the diagonal where nothing is known. With a
// shared focal length both its rows hold the same values.
TwoViewMatrix EstimateCovariance(const TwoViewData& data,
                                 FocalCase focal_case,
                                 const TwoViewCostOptions& cost_options,
                                 const TwoViewModel& model,
                                 const DepthFields& fields);

}  // namespace dgsfm
