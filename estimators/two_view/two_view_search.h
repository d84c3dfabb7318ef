// Random sampling with local optimisation over the models of an image pair.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_problem.h"

namespace dgsfm {

struct TwoViewSearchResult {
  // Infinite cost if nothing was found.
  TwoViewCandidate with_depth;
  TwoViewCandidate without_depth;
  int num_trials = 0;
};

TwoViewSearchResult SearchTwoViewModel(const TwoViewProblem& problem,
                                       SplitMix64* random);

}  // namespace dgsfm
