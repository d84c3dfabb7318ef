// The last refinement of an image pair, its covariance, and what it cannot
// tell.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_problem.h"

namespace dgsfm {

// Refines the candidate with the noise that it shows itself and fills the
// result, whose mask has a zero for every match, except for num_trials. Returns
// the refined candidate.
TwoViewCandidate FinishTwoViewModel(const TwoViewProblem& problem,
                                    const TwoViewCandidate& candidate,
                                    SplitMix64* random,
                                    TwoViewDepthResult* result);

}  // namespace dgsfm
