#include "estimators/position_alignment.h"

#include "estimators/median.h"
#include "estimators/random.h"
#include "estimators/rotation_vector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

namespace dgsfm {

namespace {

using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix37d = Eigen::Matrix<double, 3, 7>;

constexpr size_t kMinNumMatches = 3;
// The quantile of errors that samples minimise: up to 45 % may be outliers.
constexpr double kQuantile = 0.55;
// Median length of a vector of three normally distributed components.
constexpr double kMedianLength = 1.538;
// Change of the solution that ends the iterations [standard deviations].
constexpr double kMinStep = 1e-6;
// Information on what nothing else holds, such as the rotation about the line
// that positions are on [1 / rad^2].
constexpr double kMinInformation = 1e-6;

double ErrorOf(const Similarity3d& target_from_source,
               const PositionMatch& match) {
  return (match.target_sqrt_information *
          (target_from_source * match.source - match.target))
      .norm();
}

std::vector<double> ErrorsOf(const Similarity3d& target_from_source,
                             const std::vector<PositionMatch>& matches) {
  std::vector<double> errors;
  for (const PositionMatch& match : matches) {
    errors.push_back(ErrorOf(target_from_source, match));
  }
  return errors;
}

// Closed form of three matches [Umeyama 1991] and of the direction, which
// counts as one of them.
std::optional<Similarity3d> AlignThree(
    const std::array<const PositionMatch*, 3>& matches,
    const std::optional<double>& fixed_scale,
    const std::optional<DirectionMatch>& up) {
  Eigen::Vector3d source = Eigen::Vector3d::Zero();
  Eigen::Vector3d target = Eigen::Vector3d::Zero();
  for (const PositionMatch* match : matches) {
    source += match->source / 3;
    target += match->target / 3;
  }
  double source_extent = 0, target_extent = 0;
  Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
  for (const PositionMatch* match : matches) {
    source_extent += (match->source - source).squaredNorm();
    target_extent += (match->target - target).squaredNorm();
    products += (match->target - target) * (match->source - source).transpose();
  }
  const double extent = std::sqrt(source_extent * target_extent);
  if (!(extent > 0)) return std::nullopt;
  products /= extent;
  if (up) products += up->target * up->source.transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
      products, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign =
      (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  Similarity3d result;
  result.rotation = Eigen::Quaterniond(
      Eigen::Matrix3d(svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() *
                      svd.matrixV().transpose()));
  double product = 0;
  for (const PositionMatch* match : matches) {
    product += (match->target - target)
                   .dot(result.rotation * (match->source - source));
  }
  result.scale = fixed_scale.value_or(product / source_extent);
  if (!(result.scale > 0)) return std::nullopt;
  result.translation = target - result.scale * (result.rotation * source);
  return result;
}

// Calls `use` with the similarity of each sample of three matches.
template <typename Function>
void ForEachSample(const PositionAlignmentOptions& options,
                   const std::vector<PositionMatch>& matches,
                   const std::optional<DirectionMatch>& up,
                   const Function& use) {
  SplitMix64 random(0);
  const int count = static_cast<int>(matches.size());
  for (int trial = 0; trial < options.num_trials; ++trial) {
    std::array<int, 3> idxs;
    for (int& idx : idxs) idx = random.Below(count);
    if (idxs[0] == idxs[1] || idxs[0] == idxs[2] || idxs[1] == idxs[2]) {
      continue;
    }
    const auto sample =
        AlignThree({&matches[idxs[0]], &matches[idxs[1]], &matches[idxs[2]]},
                   options.fixed_scale,
                   up);
    if (sample) use(*sample);
  }
}

std::optional<Similarity3d> BestOfSamples(
    const PositionAlignmentOptions& options,
    const std::vector<PositionMatch>& matches,
    const std::optional<DirectionMatch>& up) {
  std::optional<Similarity3d> best;
  double best_error = std::numeric_limits<double>::infinity();
  ForEachSample(options, matches, up, [&](const Similarity3d& sample) {
    const double error = Quantile(ErrorsOf(sample, matches), kQuantile);
    if (error < best_error) {
      best_error = error;
      best = sample;
    }
  });
  return best;
}

// Normal equations of a step (w, translation of the centre, log scale) of
// x -> exp(s) s0 exp(w) R (x - centre) + t.
struct NormalEquations {
  Matrix7d hessian = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
};

NormalEquations Linearize(const Similarity3d& target_from_source,
                          const Eigen::Vector3d& center,
                          bool has_fixed_scale,
                          double loss_scale,
                          const std::vector<PositionMatch>& matches,
                          const std::optional<DirectionMatch>& up) {
  NormalEquations equations;
  for (const PositionMatch& match : matches) {
    const Eigen::Vector3d lever =
        target_from_source.scale *
        (target_from_source.rotation * (match.source - center));
    Matrix37d jacobian;
    jacobian << -CrossMatrix(lever), Eigen::Matrix3d::Identity(), lever;
    jacobian = match.target_sqrt_information * jacobian.eval();
    const Eigen::Vector3d error =
        match.target_sqrt_information *
        (target_from_source * match.source - match.target);
    const double weight =
        1 / (1 + error.squaredNorm() / (loss_scale * loss_scale));
    equations.hessian += weight * jacobian.transpose() * jacobian;
    equations.gradient += weight * jacobian.transpose() * error;
  }
  equations.hessian.topLeftCorner<3, 3>().diagonal().array() += kMinInformation;
  if (has_fixed_scale) {
    equations.hessian.row(6).setZero();
    equations.hessian.col(6).setZero();
    equations.hessian(6, 6) = 1;
    equations.gradient(6) = 0;
  }
  if (up) {
    const Eigen::Vector3d rotated = target_from_source.rotation * up->source;
    const Eigen::Matrix3d by_rotation = -CrossMatrix(rotated) / up->stddev_rad;
    const Eigen::Vector3d error = (rotated - up->target) / up->stddev_rad;
    equations.hessian.topLeftCorner<3, 3>() +=
        by_rotation.transpose() * by_rotation;
    equations.gradient.head<3>() += by_rotation.transpose() * error;
  }
  return equations;
}

void Step(const Vector7d& step,
          const Eigen::Vector3d& center,
          Similarity3d* target_from_source) {
  const Eigen::Vector3d target_center =
      *target_from_source * center + step.segment<3>(3);
  target_from_source->rotation =
      (RotationFromVector(step.head<3>()) * target_from_source->rotation)
          .normalized();
  target_from_source->scale *= std::exp(step(6));
  target_from_source->translation =
      target_center -
      target_from_source->scale * (target_from_source->rotation * center);
}

}  // namespace

Similarity3d Similarity3d::Inverse() const {
  Similarity3d inverse;
  inverse.scale = 1 / scale;
  inverse.rotation = rotation.conjugate();
  inverse.translation = -inverse.scale * (inverse.rotation * translation);
  return inverse;
}

Eigen::Vector3d operator*(const Similarity3d& target_from_source,
                          const Eigen::Vector3d& x_in_source) {
  return target_from_source.scale *
             (target_from_source.rotation * x_in_source) +
         target_from_source.translation;
}

double SpreadOfErrors(const std::vector<double>& errors) {
  return Median(errors) / kMedianLength;
}

size_t CountAgreeing(const PositionAlignmentOptions& options,
                     const std::vector<PositionMatch>& matches,
                     const std::optional<DirectionMatch>& up) {
  size_t best_count = 0;
  if (matches.size() < kMinNumMatches) return best_count;
  ForEachSample(options, matches, up, [&](const Similarity3d& sample) {
    const std::vector<double> errors = ErrorsOf(sample, matches);
    const auto count = static_cast<size_t>(
        std::count_if(errors.begin(), errors.end(), [&](double error) {
          return error <= options.max_error;
        }));
    best_count = std::max(best_count, count);
  });
  return best_count;
}

std::optional<PositionAlignment> AlignPositions(
    const PositionAlignmentOptions& options,
    const std::vector<PositionMatch>& matches,
    const std::optional<DirectionMatch>& up) {
  if (matches.size() < kMinNumMatches) return std::nullopt;
  const std::optional<Similarity3d> start = BestOfSamples(options, matches, up);
  if (!start) return std::nullopt;
  PositionAlignment result;
  Similarity3d& similarity = result.target_from_source;
  similarity = *start;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (const PositionMatch& match : matches) {
    center += match.source / double(matches.size());
  }
  const auto linearize = [&] {
    const double spread = SpreadOfErrors(ErrorsOf(similarity, matches));
    return Linearize(similarity,
                     center,
                     options.fixed_scale.has_value(),
                     options.loss_scale * std::max(1.0, spread),
                     matches,
                     up);
  };
  for (int i = 0; i < options.max_num_iterations; ++i) {
    const NormalEquations equations = linearize();
    const Vector7d step = -equations.hessian.ldlt().solve(equations.gradient);
    if (!step.allFinite()) return std::nullopt;
    Step(step, center, &similarity);
    if (step.dot(equations.hessian * step) < kMinStep * kMinStep) break;
  }
  result.errors = ErrorsOf(similarity, matches);
  result.spread = SpreadOfErrors(result.errors);
  const double factor = std::max(1.0, result.spread);
  for (const double error : result.errors) {
    result.is_inlier.push_back(error <= options.max_error * factor);
    result.num_inliers += result.is_inlier.back();
  }
  const Matrix7d covariance = linearize().hessian.inverse();
  if (!covariance.allFinite() || !similarity.translation.allFinite()) {
    return std::nullopt;
  }
  if (!options.fixed_scale) {
    result.log_scale_stddev = factor * std::sqrt(covariance(6, 6));
  }
  const Eigen::Matrix3d rotation_covariance = covariance.topLeftCorner<3, 3>();
  result.rotation_stddev_rad =
      factor * std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(
                             rotation_covariance)
                             .eigenvalues()(2));
  return result;
}

}  // namespace dgsfm
