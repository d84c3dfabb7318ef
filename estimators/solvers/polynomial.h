// Polynomials of low degree and their real roots, for minimal solvers. No
// allocation.

#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dgsfm {

// c[0] + c[1] x + ... + c[N - 1] x^(N - 1)
template <size_t N>
using Polynomial = std::array<double, N>;

template <size_t N, size_t M>
Polynomial<N + M - 1> operator*(const Polynomial<N>& a,
                                const Polynomial<M>& b) {
  Polynomial<N + M - 1> product{};
  for (size_t i = 0; i < N; ++i) {
    for (size_t k = 0; k < M; ++k) product[i + k] += a[i] * b[k];
  }
  return product;
}

template <size_t N>
Polynomial<N> operator*(double factor, Polynomial<N> a) {
  for (double& value : a) value *= factor;
  return a;
}

template <size_t N>
Polynomial<N> operator+(Polynomial<N> a, const Polynomial<N>& b) {
  for (size_t i = 0; i < N; ++i) a[i] += b[i];
  return a;
}

template <size_t N>
Polynomial<N> operator-(const Polynomial<N>& a, const Polynomial<N>& b) {
  return a + (-1.0) * b;
}

template <size_t N>
double Evaluate(const Polynomial<N>& c, double x) {
  double value = c[N - 1];
  for (size_t k = N - 1; k-- > 0;) value = value * x + c[k];
  return value;
}

template <size_t N>
Polynomial<N - 1> Derivative(const Polynomial<N>& c) {
  Polynomial<N - 1> derivative;
  for (size_t k = 1; k < N; ++k) derivative[k - 1] = k * c[k];
  return derivative;
}

// The root between low and high, where the values have different signs: Newton
// steps, bisection where they leave the bracket or do not halve it.
template <size_t N>
double RootBetween(const Polynomial<N>& c, double low, double high) {
  constexpr int kMaxNumSteps = 60;
  // Newton steps square the error: nothing of this is left after the last one.
  constexpr double kPrecision = 1e-8;
  const Polynomial<N - 1> derivative = Derivative(c);
  const bool rising = Evaluate(c, low) < 0;
  double x = 0.5 * (low + high);
  double last_step = high - low;
  for (int step = 0; step < kMaxNumSteps; ++step) {
    const double value = Evaluate(c, x);
    const double newton_step = -value / Evaluate(derivative, x);
    // Rounding may put the root itself on the wrong side of a bound.
    if (std::abs(newton_step) <= kPrecision * std::abs(x)) {
      return x + newton_step;
    }
    ((value < 0) == rising ? low : high) = x;
    double next = x + newton_step;
    // Written so that NaN bisects.
    if (!(next > low && next < high &&
          std::abs(newton_step) <= 0.5 * std::abs(last_step))) {
      next = 0.5 * (low + high);
    }
    last_step = next - x;
    x = next;
  }
  return x;
}

// The first `count` values are roots, ascending.
template <size_t N>
struct RealRoots {
  int count = 0;
  std::array<double, N - 1> values;

  void Add(double root) { values[count++] = root; }
};

// Solvers scale their unknowns to be of order one: larger roots are arbitrary.
constexpr double kMaxRoot = 100;

// The real roots within [-max_root, max_root] by those of the derivatives.
// Double roots may be missing. Leading coefficients of zero lower the degree.
template <size_t N>
RealRoots<N> FindRealRoots(const Polynomial<N>& c, double max_root = kMaxRoot) {
  RealRoots<N> roots;
  if constexpr (N == 2) {
    const double root = -c[0] / c[1];
    if (std::abs(root) <= max_root) roots.Add(root);
  } else {
    // Between two roots of its derivative a polynomial is monotonic and has at
    // most one root, where its sign changes.
    const RealRoots<N - 1> turns = FindRealRoots(Derivative(c), max_root);
    double low = -max_root;
    bool low_is_negative = Evaluate(c, low) < 0;
    for (int i = 0; i <= turns.count; ++i) {
      const double high = i < turns.count ? turns.values[i] : max_root;
      const bool high_is_negative = Evaluate(c, high) < 0;
      if (low_is_negative != high_is_negative) {
        roots.Add(RootBetween(c, low, high));
      }
      low = high;
      low_is_negative = high_is_negative;
    }
  }
  return roots;
}

// The Sturm chain p0 = c, p1 = c', p(k+1) = -(p(k-1) mod pk), each times a
// positive factor, by the linear quotients of its neighbours:
//   p(k-1)(x) = (slope_k x + offset_k) pk(x) - factor_k p(k+1)(x).
template <size_t N>
class SturmChain {
 public:
  explicit SturmChain(const Polynomial<N>& c) {
    Polynomial<N> previous = c;
    Polynomial<N> current{};
    for (size_t k = 1; k < N; ++k) current[k - 1] = k * c[k];
    for (size_t k = 1, degree = N - 2; degree > 0; ++k, --degree) {
      const double slope = previous[degree + 1] / current[degree];
      const double offset =
          (previous[degree] - slope * current[degree - 1]) / current[degree];
      for (size_t i = 0; i < degree; ++i) {
        previous[i] = offset * current[i] - previous[i] +
                      (i > 0 ? slope * current[i - 1] : 0);
      }
      const double factor = std::abs(previous[degree - 1]);
      for (size_t i = 0; i < degree; ++i) previous[i] /= factor;
      quotients_[k] = {slope, offset, factor};
      std::swap(previous, current);
    }
    last_linear_ = {previous[0], previous[1]};
    constant_ = current[0];
  }

  // False if a remainder has a leading coefficient of zero: the quotients are
  // not linear then.
  bool IsRegular() const { return std::isfinite(constant_); }

  // The number of roots between low and high is the difference of the numbers
  // of sign changes there.
  int NumSignChanges(double x) const {
    double next = constant_;
    double value = Evaluate(last_linear_, x);
    int count = (value < 0) != (next < 0);
    for (size_t k = N - 2; k > 0; --k) {
      const Quotient& quotient = quotients_[k];
      const double previous = (quotient.slope * x + quotient.offset) * value -
                              quotient.factor * next;
      count += (previous < 0) != (value < 0);
      next = value;
      value = previous;
    }
    return count;
  }

 private:
  struct Quotient {
    double slope, offset, factor;
  };

  std::array<Quotient, N - 1> quotients_;
  Polynomial<2> last_linear_;
  double constant_;
};

// Adds the roots between low and high, of which there are as many as the
// numbers of sign changes differ.
template <size_t N>
void AddRootsBetween(const Polynomial<N>& c,
                     const SturmChain<N>& chain,
                     double low,
                     double high,
                     int num_changes_low,
                     int num_changes_high,
                     RealRoots<N>* roots) {
  const int count = num_changes_low - num_changes_high;
  // Numbers that rounding makes wrong may add up to too many.
  if (count <= 0 || roots->count == static_cast<int>(N) - 1) return;
  if (count == 1) {
    if ((Evaluate(c, low) < 0) != (Evaluate(c, high) < 0)) {
      roots->Add(RootBetween(c, low, high));
    }
    return;
  }
  const double middle = 0.5 * (low + high);
  // No number lies between the bounds of double roots in the end.
  if (!(middle > low && middle < high)) return;
  const int num_changes = chain.NumSignChanges(middle);
  AddRootsBetween(c, chain, low, middle, num_changes_low, num_changes, roots);
  AddRootsBetween(c, chain, middle, high, num_changes, num_changes_high, roots);
}

// FindRealRoots for polynomials of high degree: of degree 10 in a third of its
// time.
template <size_t N>
RealRoots<N> FindRealRootsBySturm(const Polynomial<N>& c,
                                  double max_root = kMaxRoot) {
  const SturmChain<N> chain(c);
  if (!chain.IsRegular()) return FindRealRoots(c, max_root);
  RealRoots<N> roots;
  AddRootsBetween(c,
                  chain,
                  -max_root,
                  max_root,
                  chain.NumSignChanges(-max_root),
                  chain.NumSignChanges(max_root),
                  &roots);
  return roots;
}

}  // namespace dgsfm
