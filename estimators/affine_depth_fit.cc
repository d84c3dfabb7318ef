#include "estimators/affine_depth_fit.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Core>
#include <Eigen/LU>

namespace dgsfm {
namespace {

using Samples = std::vector<AffineDepthSample>;

// Errors besides relative ones [range of the map].
constexpr double kMinErrorOfRange = 0.01;
// Share of the values on either side that the range leaves out.
constexpr double kRangeQuantile = 0.05;
constexpr int kNumIterations = 30;
// Width of the Cauchy weights [standard deviations].
constexpr double kCauchyWidth = 2;
// Smooth errors make the places of a pair as good as so many independent ones:
// the shifts of maps of a set of photos scatter accordingly.
constexpr double kNumIndependent = 10;
// Concordance below which pairs determine no shift.
constexpr double kMinConcordance = 0.2;

std::vector<double> ValuesOf(const Samples& samples) {
  std::vector<double> values;
  for (const AffineDepthSample& sample : samples) {
    values.push_back(sample.value);
  }
  return values;
}

void SortByPredictor(Samples* samples) {
  std::sort(samples->begin(),
            samples->end(),
            [](const AffineDepthSample& a, const AffineDepthSample& b) {
              return std::make_pair(a.predictor, a.value) <
                     std::make_pair(b.predictor, b.value);
            });
}

double CauchyWeight(double error) {
  return 1 / (1 + error * error / (kCauchyWidth * kCauchyWidth));
}

struct PairFit {
  double scale = 0;  // 0 if the pair is of no use
  double shift = 0;
  double variance = 0;  // of the shift
  double scale_variance = 0;
  double noise = 0;
};

// Median slope of places half of the sample apart [Theil 1950].
PairFit StartOf(const Samples& sorted) {
  const size_t half = sorted.size() / 2;
  std::vector<double> slopes;
  for (size_t i = 0; i + half < sorted.size(); ++i) {
    const double run = sorted[i + half].predictor - sorted[i].predictor;
    if (run > 0) {
      slopes.push_back((sorted[i + half].value - sorted[i].value) / run);
    }
  }
  PairFit fit;
  if (slopes.empty()) return fit;
  fit.scale = Median(std::move(slopes));
  std::vector<double> shifts;
  for (const AffineDepthSample& sample : sorted) {
    shifts.push_back(sample.value - fit.scale * sample.predictor);
  }
  fit.shift = Median(std::move(shifts));
  return fit;
}

// Standard deviation of an error by its relative part alone, over the noise.
double ErrorUnit(const PairFit& fit,
                 const AffineDepthSample& sample,
                 double min_error) {
  return std::hypot(fit.scale * sample.predictor, min_error);
}

// One step of iteratively reweighted least squares; false if it fails.
bool RefinePairFit(const Samples& samples, double min_error, PairFit* fit) {
  std::vector<double> errors;
  for (const AffineDepthSample& sample : samples) {
    errors.push_back(
        (sample.value - fit->scale * sample.predictor - fit->shift) /
        ErrorUnit(*fit, sample, min_error));
  }
  const double noise = RobustStddev(errors, 0);
  fit->noise = noise;
  if (!(noise > 0)) return true;
  Eigen::Matrix2d hessian = Eigen::Matrix2d::Zero();
  Eigen::Vector2d rhs = Eigen::Vector2d::Zero();
  double sum_weights = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    const double robust = CauchyWeight(errors[i] / noise);
    const double unit = ErrorUnit(*fit, samples[i], min_error);
    const Eigen::Vector2d row(samples[i].predictor, 1);
    hessian += robust / (unit * unit) * row * row.transpose();
    rhs += robust / (unit * unit) * samples[i].value * row;
    sum_weights += robust;
  }
  if (!(hessian.determinant() > 1e-12 * hessian(0, 0) * hessian(1, 1))) {
    return false;
  }
  const Eigen::Matrix2d covariance = noise * noise * hessian.inverse();
  const Eigen::Vector2d solution = hessian.inverse() * rhs;
  fit->scale = solution(0);
  fit->shift = solution(1);
  const double dependence = std::max(1.0, sum_weights / kNumIndependent);
  fit->scale_variance = covariance(0, 0) * dependence;
  fit->variance = covariance(1, 1) * dependence;
  return fit->scale > 0;
}

PairFit FitPair(const Samples& sorted, double min_error) {
  PairFit fit = StartOf(sorted);
  for (int i = 0; i < kNumIterations && fit.scale > 0; ++i) {
    const PairFit before = fit;
    if (!RefinePairFit(sorted, min_error, &fit)) return {};
    if (std::abs(fit.shift - before.shift) < 1e-3 * min_error) break;
  }
  if (!(fit.scale > 0) || !std::isfinite(fit.shift)) return {};
  fit.variance =
      std::max(fit.variance, min_error * min_error / kNumIndependent);
  return fit;
}

// Mean of the shifts of pairs with a spread of their own besides their
// variances.
void CombineShifts(const std::vector<PairFit>& fits, AffineDepthFit* result) {
  double least_variance = std::numeric_limits<double>::max();
  for (const PairFit& fit : fits) {
    if (fit.scale > 0) {
      least_variance = std::min(least_variance, fit.variance);
    }
  }
  // The best pair, and not the median of all, of which most may be vague.
  double shift = 0;
  for (const PairFit& fit : fits) {
    if (fit.scale > 0 && fit.variance == least_variance) shift = fit.shift;
  }
  double spread = 0;
  double sum_weights = 0;
  for (int i = 0; i < kNumIterations; ++i) {
    sum_weights = 0;
    double sum = 0;
    double sum_excess = 0;
    double sum_robust = 0;
    for (const PairFit& fit : fits) {
      if (!(fit.scale > 0)) continue;
      const double variance = fit.variance + spread;
      const double error = fit.shift - shift;
      const double robust = CauchyWeight(error / std::sqrt(variance));
      sum += robust / variance * fit.shift;
      sum_weights += robust / variance;
      const double share = robust * least_variance / variance;
      sum_excess += share * (error * error - fit.variance);
      sum_robust += share;
    }
    shift = sum / sum_weights;
    spread = std::max(0.0, sum_excess / sum_robust);
  }
  result->shift = shift;
  // Pairs share the errors of the map, which do not average out over them.
  result->shift_stddev = std::sqrt(std::max(1 / sum_weights, least_variance));
}

// Scales, noise and number of places with the shift of all pairs.
void MeasureWithShift(const std::vector<Samples>& pairs,
                      double min_error,
                      AffineDepthFit* result) {
  std::vector<double> errors;
  for (size_t p = 0; p < pairs.size(); ++p) {
    if (result->scales[p] == 0) continue;
    std::vector<double> scales;
    for (const AffineDepthSample& sample : pairs[p]) {
      scales.push_back((sample.value - result->shift) / sample.predictor);
    }
    const double scale = Median(std::move(scales));
    result->scales[p] = std::max(scale, 0.0);
    if (!(scale > 0)) continue;
    ++result->num_pairs;
    result->num_samples += pairs[p].size();
    for (const AffineDepthSample& sample : pairs[p]) {
      const double expected = scale * sample.predictor;
      errors.push_back((sample.value - result->shift - expected) /
                       std::hypot(expected, min_error));
    }
  }
  result->noise = errors.empty() ? 0 : RobustStddev(std::move(errors), 0);
}

void CheckSamples(const Samples& samples) {
  for (const AffineDepthSample& sample : samples) {
    DGSFM_CHECK(std::isfinite(sample.value) && sample.predictor > 0 &&
                std::isfinite(sample.predictor))
        << sample.value << ", " << sample.predictor;
  }
}

std::string Percent(double share) {
  return std::to_string(std::lround(100 * share)) + " %";
}

// Why the shift cannot be used; empty if it can.
std::string Objection(const Samples& all,
                      const AffineDepthFit& fit,
                      const AffineDepthFitOptions& options) {
  const std::vector<double> values = ValuesOf(all);
  if (fit.num_pairs == 0 || !(Quantile(values, kRangeQuantile) > fit.shift)) {
    return "its values contradict the triangulated depths";
  }
  if (fit.noise > options.max_noise) {
    return "its values are off by " + Percent(fit.noise) +
           " after the best scale and shift";
  }
  const double difference = Quantile(values, 0.5) - fit.shift;
  if (fit.shift_stddev > options.max_shift_error * difference) {
    return "its shift is uncertain by " +
           Percent(fit.shift_stddev / difference) + " of the median value";
  }
  return "";
}

}  // namespace

bool AffineDepthFitOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("min_num_samples", min_num_samples, 3)
      .Above("max_noise", max_noise, 0)
      .Above("max_shift_error", max_shift_error, 0)
      .AreKept();
}

double Concordance(Samples samples) {
  SortByPredictor(&samples);
  const size_t half = samples.size() / 2;
  if (half == 0) return 0;
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i + half < samples.size(); ++i, ++count) {
    const double rise = samples[i + half].value - samples[i].value;
    sum += (rise > 0) - (rise < 0);
  }
  return sum / double(count);
}

AffineDepthFit FitAffineDepth(const std::vector<Samples>& given_pairs,
                              const AffineDepthFitOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  AffineDepthFit result;
  std::vector<Samples> pairs = given_pairs;
  Samples all;
  double sum_concordance = 0;
  for (Samples& samples : pairs) {
    CheckSamples(samples);
    if (samples.size() < size_t(options.min_num_samples)) samples.clear();
    SortByPredictor(&samples);
    all.insert(all.end(), samples.begin(), samples.end());
    sum_concordance += double(samples.size()) * Concordance(samples);
  }
  result.scales.assign(pairs.size(), 0);
  result.scale_stddevs.assign(pairs.size(), 0);
  if (all.empty()) {
    result.reason = "no pair triangulates enough of its places";
    return result;
  }
  result.concordance = sum_concordance / double(all.size());
  const std::vector<double> values = ValuesOf(all);
  const double range =
      Quantile(values, 1 - kRangeQuantile) - Quantile(values, kRangeQuantile);
  if (!(range > 0)) {
    result.reason = "its values are all the same";
    return result;
  }
  std::vector<PairFit> fits;
  for (size_t p = 0; p < pairs.size(); ++p) {
    fits.push_back(Concordance(pairs[p]) > kMinConcordance
                       ? FitPair(pairs[p], kMinErrorOfRange * range)
                       : PairFit());
    result.scales[p] = fits.back().scale;
    result.scale_stddevs[p] = std::sqrt(fits.back().scale_variance);
  }
  if (std::none_of(fits.begin(), fits.end(), [](const PairFit& fit) {
        return fit.scale > 0;
      })) {
    result.reason = "its values are unrelated to the triangulated depths";
    return result;
  }
  CombineShifts(fits, &result);
  MeasureWithShift(pairs, kMinErrorOfRange * range, &result);
  result.reason = Objection(all, result, options);
  result.success = result.reason.empty();
  return result;
}

}  // namespace dgsfm
