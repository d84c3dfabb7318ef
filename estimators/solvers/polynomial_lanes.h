// Polynomials of eight problems at a time and their real roots, for minimal
// solvers. No allocation.

#pragma once

#include "estimators/lanes.h"
#include "estimators/solvers/polynomial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dgsfm {

// c[0] + c[1] x + ... + c[N - 1] x^(N - 1) in each lane.
template <size_t N>
struct LanePolynomial {
  Lanes c[N] = {};

  DGSFM_INLINE Polynomial<N> AtLane(int lane) const {
    Polynomial<N> polynomial;
    for (size_t i = 0; i < N; ++i) polynomial[i] = c[i][lane];
    return polynomial;
  }
};

template <size_t N, size_t M>
DGSFM_INLINE LanePolynomial<N + M - 1> operator*(const LanePolynomial<N>& a,
                                                 const LanePolynomial<M>& b) {
  LanePolynomial<N + M - 1> product;
  for (size_t i = 0; i < N; ++i) {
    for (size_t k = 0; k < M; ++k) product.c[i + k] += a.c[i] * b.c[k];
  }
  return product;
}

template <size_t N>
DGSFM_INLINE LanePolynomial<N> operator+(const LanePolynomial<N>& a,
                                         const LanePolynomial<N>& b) {
  LanePolynomial<N> sum;
  for (size_t i = 0; i < N; ++i) sum.c[i] = a.c[i] + b.c[i];
  return sum;
}

template <size_t N>
DGSFM_INLINE LanePolynomial<N> operator-(const LanePolynomial<N>& a,
                                         const LanePolynomial<N>& b) {
  LanePolynomial<N> difference;
  for (size_t i = 0; i < N; ++i) difference.c[i] = a.c[i] - b.c[i];
  return difference;
}

template <size_t N>
DGSFM_INLINE Lanes Evaluate(const LanePolynomial<N>& p, const Lanes& x) {
  Lanes value = p.c[N - 1];
  for (size_t k = N - 1; k-- > 0;) value = value * x + p.c[k];
  return value;
}

// The Sturm chain p0 = p, p1 = p', p(k+1) = -(p(k-1) mod pk), each times a
// positive factor, by the linear quotients of its neighbours:
//   p(k-1)(x) = (slope_k x + offset_k) pk(x) - factor_k p(k+1)(x).
template <size_t N>
class SturmChain {
 public:
  explicit DGSFM_INLINE SturmChain(const LanePolynomial<N>& p) {
    Lanes chain[2][N] = {};
    Lanes* previous = chain[0];
    Lanes* current = chain[1];
    for (size_t i = 0; i < N; ++i) previous[i] = p.c[i];
    for (size_t i = 1; i < N; ++i) {
      current[i - 1] = static_cast<double>(i) * p.c[i];
    }
    for (size_t k = 1, degree = N - 2; degree > 0; ++k, --degree) {
      const Lanes inverse = 1 / current[degree];
      const Lanes slope = previous[degree + 1] * inverse;
      const Lanes offset =
          (previous[degree] - slope * current[degree - 1]) * inverse;
      previous[0] = offset * current[0] - previous[0];
      for (size_t i = 1; i < degree; ++i) {
        previous[i] =
            offset * current[i] - previous[i] + slope * current[i - 1];
      }
      const Lanes leading = previous[degree - 1];
      const Lanes factor = leading < 0.0 ? -leading : leading;
      const Lanes inverse_factor = 1 / factor;
      for (size_t i = 0; i < degree; ++i) previous[i] *= inverse_factor;
      slopes_[k] = slope;
      offsets_[k] = offset;
      factors_[k] = factor;
      std::swap(previous, current);
    }
    last_linear_ = {{previous[0], previous[1]}};
    constant_ = current[0];
  }

  // False if a remainder has a leading coefficient of zero: the quotients are
  // not linear then.
  bool IsRegular(int lane) const { return std::isfinite(constant_[lane]); }

  // The number of roots between low and high is the difference of the numbers
  // of sign changes there.
  DGSFM_INLINE Lanes NumSignChanges(double x) const {
    const Lanes one = 1.0 + Lanes{};
    Lanes next = constant_;
    Lanes value = last_linear_.c[0] + last_linear_.c[1] * x;
    Lanes is_negative = value < 0.0 ? one : Lanes{};
    Lanes count = Abs(is_negative - (next < 0.0 ? one : Lanes{}));
    for (size_t k = N - 2; k > 0; --k) {
      const Lanes previous =
          (slopes_[k] * x + offsets_[k]) * value - factors_[k] * next;
      const Lanes previous_is_negative = previous < 0.0 ? one : Lanes{};
      count += Abs(previous_is_negative - is_negative);
      next = value;
      value = previous;
      is_negative = previous_is_negative;
    }
    return count;
  }

  int NumSignChanges(double x, int lane) const {
    double next = constant_[lane];
    double value = last_linear_.c[0][lane] + last_linear_.c[1][lane] * x;
    int count = (value < 0) != (next < 0);
    for (size_t k = N - 2; k > 0; --k) {
      const double previous =
          (slopes_[k][lane] * x + offsets_[k][lane]) * value -
          factors_[k][lane] * next;
      count += (previous < 0) != (value < 0);
      next = value;
      value = previous;
    }
    return count;
  }

 private:
  Lanes slopes_[N - 1], offsets_[N - 1], factors_[N - 1];
  LanePolynomial<2> last_linear_;
  Lanes constant_;
};

// Intervals that hold one root each, ascending.
template <size_t N>
struct RootBrackets {
  std::array<int, kNumLanes> counts = {};
  // Bounds of the first, second, ... interval of each lane.
  Lanes low[N - 1] = {}, high[N - 1] = {};

  // Numbers that rounding makes wrong may add up to too many.
  void Add(int lane, double min, double max) {
    if (counts[lane] == static_cast<int>(N) - 1) return;
    const int i = counts[lane]++;
    low[i][lane] = min;
    high[i][lane] = max;
  }
};

// Halves an interval until each part holds one root at most. There are as many
// roots as the numbers of sign changes differ.
template <size_t N>
void AddBrackets(const SturmChain<N>& chain,
                 int lane,
                 double low,
                 double high,
                 int num_changes_low,
                 int num_changes_high,
                 RootBrackets<N>* brackets) {
  const int count = num_changes_low - num_changes_high;
  if (count <= 0) return;
  if (count == 1) {
    brackets->Add(lane, low, high);
    return;
  }
  const double middle = 0.5 * (low + high);
  // No number lies between the bounds of double roots in the end.
  if (!(middle > low && middle < high)) return;
  const int num_changes = chain.NumSignChanges(middle, lane);
  AddBrackets(chain, lane, low, middle, num_changes_low, num_changes, brackets);
  AddBrackets(
      chain, lane, middle, high, num_changes, num_changes_high, brackets);
}

// Bounds of intervals between -kMaxRoot and kMaxRoot, of equal probability for
// quotients of normal variables.
inline constexpr int kNumRootIntervals = 32;
inline const std::array<double, kNumRootIntervals + 1> kRootBounds = [] {
  std::array<double, kNumRootIntervals + 1> bounds;
  for (int i = 0; i <= kNumRootIntervals; ++i) {
    bounds[i] =
        std::tan((2.0 * i / kNumRootIntervals - 1) * std::atan(kMaxRoot));
  }
  return bounds;
}();

template <size_t N>
DGSFM_INLINE RootBrackets<N> BracketRoots(const SturmChain<N>& chain) {
  Lanes num_changes[kNumRootIntervals + 1];
  // Intervals with roots, found without branches.
  int intervals[kNumLanes][kNumRootIntervals + 1];
  int num_intervals[kNumLanes] = {};
  num_changes[0] = chain.NumSignChanges(kRootBounds[0]);
  for (int i = 0; i < kNumRootIntervals; ++i) {
    num_changes[i + 1] = chain.NumSignChanges(kRootBounds[i + 1]);
    const auto has_roots = num_changes[i] > num_changes[i + 1];
    for (int lane = 0; lane < kNumLanes; ++lane) {
      intervals[lane][num_intervals[lane]] = i;
      num_intervals[lane] -= static_cast<int>(has_roots[lane]);
    }
  }
  RootBrackets<N> brackets;
  for (int lane = 0; lane < kNumLanes; ++lane) {
    for (int k = 0; k < num_intervals[lane]; ++k) {
      const int i = intervals[lane][k];
      AddBrackets(chain,
                  lane,
                  kRootBounds[i],
                  kRootBounds[i + 1],
                  static_cast<int>(num_changes[i][lane]),
                  static_cast<int>(num_changes[i + 1][lane]),
                  &brackets);
    }
  }
  return brackets;
}

// The roots between `min` and `max`, where the values have different signs:
// Newton steps, bisection where they leave the bracket or do not halve it.
template <size_t N>
DGSFM_INLINE Lanes RootsBetween(const LanePolynomial<N>& p,
                                const Lanes& min,
                                const Lanes& max) {
  Lanes low = min;
  Lanes high = max;
  // Turns falling polynomials over.
  const Lanes sign = Evaluate(p, min) < 0.0 ? 1.0 + Lanes{} : -1.0 + Lanes{};
  Lanes x = 0.5 * (low + high);
  Lanes last_step = high - low;
  Lanes root = x;
  // 1, or 0 where the root is found. Empty intervals have none.
  Lanes is_open = min < max ? 1.0 + Lanes{} : Lanes{};
  for (int step = 0; step < kMaxNumRootSteps; ++step) {
    Lanes value = p.c[N - 1];
    Lanes slope = {};
    for (size_t k = N - 1; k-- > 0;) {
      slope = slope * x + value;
      value = value * x + p.c[k];
    }
    const Lanes newton_step = -value / slope;
    const Lanes is_coarse =
        Abs(newton_step) > kRootPrecision * Abs(x) ? is_open : Lanes{};
    // Rounding may put the root itself on the wrong side of a bound.
    root = is_open > is_coarse ? x + newton_step : root;
    is_open = is_coarse;
    if (Sum(is_open) == 0) break;
    const auto is_low = value * sign < 0.0;
    low = is_low ? x : low;
    high = is_low ? high : x;
    const Lanes middle = 0.5 * (low + high);
    const Lanes next = x + newton_step;
    const Lanes last_x = x;
    const Lanes excess = Max(Max(low - next, next - high),
                             Abs(newton_step) - 0.5 * Abs(last_step));
    // NaN bisects.
    x = excess < 0.0 ? next : middle;
    last_step = x - last_x;
  }
  return is_open > 0.0 ? x : root;
}

// The first, second, ... roots of each lane.
template <size_t N>
struct LaneRoots {
  // The largest number of roots of a lane.
  int count = 0;
  // Ascending; NaN where a lane has fewer.
  Lanes values[N - 1];
};

// Sets the roots of a lane by those of the derivatives.
template <size_t N>
void SetRoots(const Polynomial<N>& p, int lane, LaneRoots<N>* roots) {
  const RealRoots<N> found = FindRealRoots(p);
  for (int i = 0; i < found.count; ++i) {
    if (i == roots->count) {
      roots->values[roots->count++] = std::nan("") + Lanes{};
    }
    roots->values[i][lane] = found.values[i];
  }
}

// The real roots within [-kMaxRoot, kMaxRoot]. Double roots may be missing.
template <size_t N>
DGSFM_INLINE LaneRoots<N> FindRealRoots(const LanePolynomial<N>& p) {
  const SturmChain<N> chain(p);
  const RootBrackets<N> brackets = BracketRoots(chain);
  LaneRoots<N> roots;
  for (const int count : brackets.counts) {
    roots.count = std::max(roots.count, count);
  }
  for (int i = 0; i < roots.count; ++i) {
    const Lanes& low = brackets.low[i];
    const Lanes& high = brackets.high[i];
    const Lanes none = std::nan("") + Lanes{};
    const Lanes root = RootsBetween(p, low, high);
    const Lanes if_low_is_negative = Evaluate(p, high) < 0.0 ? none : root;
    const Lanes if_low_is_positive = Evaluate(p, high) < 0.0 ? root : none;
    roots.values[i] =
        Evaluate(p, low) < 0.0 ? if_low_is_negative : if_low_is_positive;
  }
  for (int lane = 0; lane < kNumLanes; ++lane) {
    if (!chain.IsRegular(lane)) SetRoots(p.AtLane(lane), lane, &roots);
  }
  return roots;
}

}  // namespace dgsfm
