// Filters that take pairs out of the view graph, each with its reason as
// PairStatus. docs/contributing.md lists what a new one needs.

#pragma once

#include "sfm/verification/pair_verification.h"

#include <cstddef>
#include <map>
#include <string>

namespace dgsfm {

// Scores of image pairs in [0, 1] that they show the same surface
// (Doppelgangers++), by pair id.
using PairScores = std::map<colmap::image_pair_t, double>;

struct ViewGraphFilterOptions {
  // Pairs with an imported score at or below this are removed (paper: tau_DG);
  // pairs without a score are kept.
  double min_pair_score = 0.8;
  // Pairs whose mean triplet support is at or below this are removed (paper:
  // tau_tri = 0.6). 0 = no filter: it takes more than half of the true pairs,
  // and what false ones are left after depth consistency contradict rotations
  // and translations.
  double min_triplet_support = 0;

  bool IsValid(std::string* error) const;
};

// Takes out valid pairs by imported scores; returns their number.
size_t FilterByPairScore(const ViewGraphFilterOptions& options,
                         const PairScores& scores,
                         PairGeometries* pairs);

// Takes out valid pairs by triplet support; returns their number.
size_t FilterByTripletSupport(const ViewGraphFilterOptions& options,
                              PairGeometries* pairs);

// All filters, in their order. Returns the numbers of pairs that they took out,
// by status.
std::map<PairStatus, size_t> ApplyPairFilters(
    const ViewGraphFilterOptions& options,
    const Scene& scene,
    const PairScores& scores,
    PairGeometries* pairs);

}  // namespace dgsfm
