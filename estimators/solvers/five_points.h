// Essential matrices from five matches.

#pragma once

#include "estimators/solvers/epipolar_lanes.h"

#include <array>

namespace dgsfm {

// (x2, 1)^T E (x1, 1) = 0 for five matches, det E = 0 and
// 2 E E^T E = trace(E E^T) E: at most 10 solutions of each of eight samples, of
// the norm of an orthonormal combination of the null space of the linear
// system. Points are divided by the focal lengths. Planes are no special case.
// Degenerate: points on a line, no translation.
//
// With E = x X + y Y + z Z + W the ten cubic equations are eliminated to a
// polynomial of degree 10 in z [Nister 2004]; solutions with |z| > 100 are not
// found. No allocation.
using EssentialMatrices = EpipolarMatrices<10>;
std::array<EssentialMatrices, kNumLanes> SolveFivePoints(
    const SampleLanes<5>& samples);

}  // namespace dgsfm
