// The two-view estimator of the paper, RePoseD (Ding 2025): what
// TwoViewDepthOptions::paper takes. docs/two_view.md lists where it differs
// from this project's, and where it still differs from what was published.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_cost.h"
#include "estimators/two_view/two_view_problem.h"
#include "estimators/two_view/two_view_search.h"

#include <vector>

namespace dgsfm {

// Samples of three matches with depth, scored by their Sampson errors, each
// better one refined over all matches. Nothing is found without depths.
TwoViewSearchResult SearchPublishedModel(const TwoViewProblem& problem,
                                         SplitMix64* random);

struct PublishedRefinement {
  TwoViewModel model;
  // Inliers of the model before the refinement.
  std::vector<int> inliers;
  TwoViewMatrix covariance;
};

// Refines a model over its inliers, with a loss that does not exclude any.
PublishedRefinement RefinePublishedModel(const TwoViewProblem& problem,
                                         const TwoViewModel& model);

}  // namespace dgsfm
