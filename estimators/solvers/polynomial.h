// Polynomials of low degree and their real roots, for minimal solvers. No
// allocation.

#pragma once

#include <array>
#include <cmath>
#include <cstddef>

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

// Steps to the root within a bracket.
constexpr int kMaxNumRootSteps = 60;
// Relative size of the last step. Newton steps square the error: nothing of
// this is left after it.
constexpr double kRootPrecision = 1e-8;

// The root between low and high, where the values have different signs: Newton
// steps, bisection where they leave the bracket or do not halve it.
template <size_t N>
double RootBetween(const Polynomial<N>& c, double low, double high) {
  const Polynomial<N - 1> derivative = Derivative(c);
  const bool rising = Evaluate(c, low) < 0;
  double x = 0.5 * (low + high);
  double last_step = high - low;
  for (int step = 0; step < kMaxNumRootSteps; ++step) {
    const double value = Evaluate(c, x);
    const double newton_step = -value / Evaluate(derivative, x);
    // Rounding may put the root itself on the wrong side of a bound.
    if (std::abs(newton_step) <= kRootPrecision * std::abs(x)) {
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

}  // namespace dgsfm
