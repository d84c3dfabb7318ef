#include "estimators/solvers/polynomial.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dgsfm {
namespace {

// Below this share of the largest coefficient the leading one is rounding.
constexpr double kNegligible = 1e-14;
// Newton doubles the digits: closed forms give 5 to 8 of them in bad cases.
constexpr int kNumNewtonSteps = 3;

template <size_t N>
bool IsLowerDegree(const std::array<double, N>& c) {
  double largest = 0;
  for (const double value : c) largest = std::max(largest, std::abs(value));
  return std::abs(c[0]) <= kNegligible * largest;
}

template <size_t N>
bool IsFinite(const std::array<double, N>& c) {
  return std::all_of(
      c.begin(), c.end(), [](double value) { return std::isfinite(value); });
}

template <size_t N>
void Polish(const std::array<double, N>& c, RealRoots* roots) {
  for (int i = 0; i < roots->count; ++i) {
    double x = roots->values[i];
    double last_step = std::abs(x) + 1;
    for (int step = 0; step < kNumNewtonSteps; ++step) {
      double value = c[0];
      double slope = 0;
      for (size_t k = 1; k < N; ++k) {
        slope = slope * x + value;
        value = value * x + c[k];
      }
      const double dx = value / slope;
      // Near a double root Newton leaves the neighbourhood: keep what we have.
      if (!(std::abs(dx) < last_step)) break;
      x -= dx;
      last_step = std::abs(dx);
    }
    roots->values[i] = x;
  }
}

// x^2 + b x + c without cancellation.
void AddQuadraticRoots(double b, double c, double shift, RealRoots* roots) {
  double discriminant = b * b - 4 * c;
  const double noise = 1e-12 * (b * b + std::abs(4 * c));
  if (discriminant < -noise) return;
  discriminant = std::max(discriminant, 0.0);
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  roots->Add(q - shift);
  roots->Add(q == 0 ? -shift : c / q - shift);
}

// Largest real root of x^3 + b x^2 + c x + d.
double LargestCubicRoot(double b, double c, double d) {
  const double q = (b * b - 3 * c) / 9;
  const double r = (b * (2 * b * b - 9 * c) + 27 * d) / 54;
  if (r * r < q * q * q) {
    const double theta =
        std::acos(std::clamp(r / (q * std::sqrt(q)), -1.0, 1.0));
    // The three roots are -2 sqrt(q) cos((theta + 2 pi k) / 3) - b / 3.
    return -2 * std::sqrt(q) * std::cos((theta + 2 * M_PI) / 3) - b / 3;
  }
  const double a = -std::copysign(
      std::cbrt(std::abs(r) + std::sqrt(std::max(r * r - q * q * q, 0.0))), r);
  return a + (a == 0 ? 0 : q / a) - b / 3;
}

// Value and slope of c[0] + ... + c[degree] x^degree.
double EvaluateWithSlope(const double* c, int degree, double x, double* slope) {
  double value = c[degree];
  *slope = 0;
  for (int k = degree - 1; k >= 0; --k) {
    *slope = *slope * x + value;
    value = value * x + c[k];
  }
  return value;
}

// The root between low and high, where the values have different signs: Newton
// steps, bisection where they leave the bracket or do not halve it.
double RootBetween(const double* c, int degree, double low, double high) {
  constexpr int kMaxNumSteps = 60;
  constexpr double kPrecision = 1e-13;
  double slope;
  const bool rising = EvaluateWithSlope(c, degree, low, &slope) < 0;
  double x = 0.5 * (low + high);
  double last_step = high - low;
  for (int step = 0; step < kMaxNumSteps; ++step) {
    const double value = EvaluateWithSlope(c, degree, x, &slope);
    (value < 0) == rising ? low = x : high = x;
    double next = x - value / slope;
    if (!(next > low && next < high) ||
        std::abs(next - x) > 0.5 * std::abs(last_step)) {
      next = 0.5 * (low + high);
    }
    last_step = next - x;
    x = next;
    if (std::abs(last_step) <= kPrecision * std::abs(x)) break;
  }
  return x;
}

// Sturm's sequence p_0 = p, p_1 = p', p_(i+1) = -remainder(p_(i-1) / p_i), kept
// as its linear quotients: p_(i-1) = quotient_i p_i - factor_i p_(i+1), where
// the factors are positive and keep the numbers of order one.
template <int kDegree>
class SturmSequence {
 public:
  // Constant coefficient first.
  explicit SturmSequence(const std::array<double, kDegree + 1>& c) {
    std::array<double, kDegree + 1> f = c;
    std::array<double, kDegree + 1> g{};
    for (int k = 1; k <= kDegree; ++k) g[k - 1] = k * c[k];
    for (int n = kDegree; n >= 2; --n) {
      const double slope = f[n] / g[n - 1];
      const double offset = (f[n - 1] - slope * g[n - 2]) / g[n - 1];
      std::array<double, kDegree + 1> h{};
      for (int k = 0; k <= n - 2; ++k) {
        h[k] = offset * g[k] + (k > 0 ? slope * g[k - 1] : 0) - f[k];
      }
      const double factor = std::abs(h[n - 2]);
      for (int k = 0; k <= n - 2; ++k) h[k] /= factor;
      steps_[n - 1] = {slope, offset, factor};
      f = g;
      g = h;
    }
    linear_ = {f[1], f[0]};
    constant_ = g[0];
  }

  // Number of sign changes at x: its decrease between two points is the number
  // of roots between them.
  int ChangesAt(double x) const {
    double next = constant_;
    double value = linear_[0] * x + linear_[1];
    int changes = (next < 0) != (value < 0);
    for (int k = 1; k < kDegree; ++k) {
      const Step& step = steps_[k];
      const double previous =
          (step.slope * x + step.offset) * value - step.factor * next;
      changes += (previous < 0) != (value < 0);
      next = value;
      value = previous;
    }
    return changes;
  }

 private:
  struct Step {
    double slope, offset, factor;
  };
  std::array<Step, kDegree> steps_;  // from the linear polynomial up
  std::array<double, 2> linear_;
  double constant_;
};

}  // namespace

RealRoots SolveQuadratic(const std::array<double, 3>& c) {
  RealRoots roots;
  if (!IsFinite(c)) return roots;
  if (IsLowerDegree(c)) {
    if (c[1] != 0) roots.Add(-c[2] / c[1]);
    return roots;
  }
  AddQuadraticRoots(c[1] / c[0], c[2] / c[0], 0, &roots);
  return roots;
}

RealRoots SolveCubic(const std::array<double, 4>& c) {
  if (!IsFinite(c)) return {};
  if (IsLowerDegree(c)) return SolveQuadratic({c[1], c[2], c[3]});
  const double b = c[1] / c[0];
  const double d = c[2] / c[0];
  RealRoots roots;
  roots.Add(LargestCubicRoot(b, d, c[3] / c[0]));
  Polish(c, &roots);
  // Deflate by the root found: x^2 + (b + x0) x + (d + (b + x0) x0).
  const double x0 = roots.values[0];
  AddQuadraticRoots(b + x0, d + (b + x0) * x0, 0, &roots);
  Polish(c, &roots);
  return roots;
}

RealRoots SolveQuartic(const std::array<double, 5>& c) {
  if (!IsFinite(c)) return {};
  if (IsLowerDegree(c)) return SolveCubic({c[1], c[2], c[3], c[4]});
  const double a3 = c[1] / c[0];
  const double a2 = c[2] / c[0];
  const double a1 = c[3] / c[0];
  const double a0 = c[4] / c[0];
  // Depressed: y^4 + p y^2 + q y + r with x = y - a3 / 4.
  const double shift = a3 / 4;
  const double p = a2 - 6 * shift * shift;
  const double q = a1 + shift * (8 * shift * shift - 2 * a2);
  const double r = a0 - shift * (a1 - shift * (a2 - 3 * shift * shift));
  // (y^2 + p/2 + m)^2 = 2 m (y - q / (4 m))^2 where m solves the resolvent.
  const double m = LargestCubicRoot(p, p * p / 4 - r, -q * q / 8);
  RealRoots roots;
  if (m > 1e-14 * std::abs(p)) {
    const double root_2m = std::sqrt(2 * m);
    const double offset = q / (2 * root_2m);
    AddQuadraticRoots(-root_2m, p / 2 + m + offset, shift, &roots);
    AddQuadraticRoots(root_2m, p / 2 + m - offset, shift, &roots);
  } else {
    RealRoots squares;
    AddQuadraticRoots(p, r, 0, &squares);
    for (int i = 0; i < squares.count; ++i) {
      if (squares.values[i] < 0) continue;
      const double y = std::sqrt(squares.values[i]);
      roots.Add(y - shift);
      roots.Add(-y - shift);
    }
  }
  Polish(c, &roots);
  return roots;
}

BracketedRoots FindRealRoots(const std::array<double, 11>& c, double max_root) {
  constexpr int kDegree = 10;
  // Closer roots count as one pair, which has no sign change between them.
  constexpr double kMinInterval = 1e-9;
  BracketedRoots roots;
  if (!IsFinite(c)) return roots;
  const SturmSequence<kDegree> sequence(c);
  struct Interval {
    double low, high;
    int changes_low, changes_high;
  };
  // Depth first, the lower half on top: at most one pending interval per root.
  std::array<Interval, kDegree + 1> stack;
  int stack_size = 1;
  stack[0] = {-max_root,
              max_root,
              sequence.ChangesAt(-max_root),
              sequence.ChangesAt(max_root)};
  while (stack_size > 0) {
    const Interval interval = stack[--stack_size];
    const int num_roots = interval.changes_low - interval.changes_high;
    if (num_roots <= 0) continue;
    const double middle = 0.5 * (interval.low + interval.high);
    if (num_roots == 1) {
      roots.values[roots.count++] =
          RootBetween(c.data(), kDegree, interval.low, interval.high);
    } else if (interval.high - interval.low > kMinInterval &&
               stack_size + 2 <= static_cast<int>(stack.size())) {
      const int changes = sequence.ChangesAt(middle);
      stack[stack_size++] = {
          middle, interval.high, changes, interval.changes_high};
      stack[stack_size++] = {
          interval.low, middle, interval.changes_low, changes};
    }
    if (roots.count == kDegree) break;
  }
  return roots;
}

}  // namespace dgsfm
