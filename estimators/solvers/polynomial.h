// Real roots of low-degree polynomials, for minimal solvers.

#pragma once

#include <array>

namespace dgsfm {

// The first `count` values are roots, in no particular order.
struct RealRoots {
  int count = 0;
  std::array<double, 4> values;

  void Add(double root) { values[count++] = root; }
};

// Real roots of c[0] x^N + ... + c[N] = 0, N = 2, 3, 4. A leading coefficient
// that is negligible against the others lowers the degree. Double roots may be
// reported twice or, if rounding makes them complex, be missing. Coefficients
// that are not finite, or all zero, have no roots.
//
// Closed form (quartic: Ferrari with the largest root of the resolvent), then
// Newton steps on the polynomial. No allocation.
RealRoots SolveQuadratic(const std::array<double, 3>& c);
RealRoots SolveCubic(const std::array<double, 4>& c);
RealRoots SolveQuartic(const std::array<double, 5>& c);

// The real roots of c[0] + c[1] x + ... + c[10] x^10 (constant first!) within
// [-max_root, max_root], ascending, separated by Sturm's sequence, then by
// Newton steps. Double roots may be missing, and roots of polynomials of a
// lower degree (c[10] = 0). Coefficients that are not finite have no roots. No
// allocation.
struct BracketedRoots {
  int count = 0;
  std::array<double, 10> values;
};
BracketedRoots FindRealRoots(const std::array<double, 11>& c, double max_root);

}  // namespace dgsfm
