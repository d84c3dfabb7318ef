// How far a pair can be believed by what it shows alone.

#pragma once

#include "colmap_ext/pair_geometry.h"

namespace dgsfm {

// Probability that a verified pair shows the same surface from both sides and
// that its rotation is right within ten degrees, from the number and the share
// of its inliers and whether depth maps agree with them. A logistic model;
// docs/methods.md says what it was fitted to.
double PairProbability(const PairGeometry& pair);

// -log(1 - PairProbability): what it costs an explanation of the view graph to
// call the pair wrong [nat], > 0. The weight of the pair in all averages.
double PairEvidence(const PairGeometry& pair);

}  // namespace dgsfm
