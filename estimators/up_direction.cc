#include "estimators/up_direction.h"

#include "estimators/median.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace dgsfm {

namespace {

constexpr size_t kMinNumCameras = 3;
constexpr int kNumIterations = 20;
// Deviations below which all weigh the same [rad].
constexpr double kMinDeviation = 1e-3;
// Sine of the angle that horizontal axes must spread by to hold the vertical.
constexpr double kMinAxesSpread = 0.2;
// Deviations of gravity, which the orientation tag gives by quarters, may be
// this many times those of level cameras.
constexpr double kGravityFactor = 3;

double Angle(const Eigen::Vector3d& unit1, const Eigen::Vector3d& unit2) {
  return std::acos(std::clamp(unit1.dot(unit2), -1.0, 1.0));
}

// The share of the deviations up to a bound.
double ShareWithin(double max_rad, const std::vector<double>& deviations_rad) {
  return double(std::count_if(
             deviations_rad.begin(),
             deviations_rad.end(),
             [&](double deviation) { return deviation <= max_rad; })) /
         double(deviations_rad.size());
}

Eigen::Vector3d MedianDirection(const std::vector<Eigen::Vector3d>& units) {
  Eigen::Vector3d median = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& unit : units) median += unit;
  for (int i = 0; i < kNumIterations && !median.isZero(); ++i) {
    median.normalize();
    Eigen::Vector3d next = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& unit : units) {
      next += unit / std::max((unit - median).norm(), kMinDeviation);
    }
    median = next;
  }
  return median.isZero() ? median : median.normalized();
}

std::optional<UpDirection> UpByGravity(
    const UpDirectionOptions& options,
    const std::vector<LevelCamera>& cameras) {
  std::vector<Eigen::Vector3d> ups;
  for (const LevelCamera& camera : cameras) {
    if (camera.gravity.isZero(0)) continue;
    ups.push_back(camera.cam_from_world.conjugate() * -camera.gravity);
  }
  if (ups.size() < kMinNumCameras || 2 * ups.size() < cameras.size()) {
    return std::nullopt;
  }
  UpDirection up;
  up.in_world = MedianDirection(ups);
  up.is_by_gravity = true;
  if (up.in_world.isZero()) return std::nullopt;
  std::vector<double> deviations;
  for (const Eigen::Vector3d& unit : ups) {
    deviations.push_back(Angle(unit, up.in_world));
  }
  if (ShareWithin(kGravityFactor * options.max_roll_deg * M_PI / 180,
                  deviations) < options.min_share) {
    return std::nullopt;
  }
  up.spread_rad = Median(deviations);
  return up;
}

std::optional<UpDirection> UpOfLevelCameras(
    const UpDirectionOptions& options,
    const std::vector<LevelCamera>& cameras) {
  std::vector<Eigen::Vector3d> axes, uppers;
  for (const LevelCamera& camera : cameras) {
    axes.push_back(camera.cam_from_world.conjugate() *
                   Eigen::Vector3d::UnitX());
    uppers.push_back(camera.cam_from_world.conjugate() *
                     -Eigen::Vector3d::UnitY());
  }
  const Eigen::Vector3d mean_upper = MedianDirection(uppers);
  UpDirection up;
  up.in_world = mean_upper;
  for (int i = 0; i < kNumIterations; ++i) {
    Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
    double sum = 0;
    for (const Eigen::Vector3d& axis : axes) {
      const double weight =
          i == 0 ? 1
                 : 1 / std::max(std::abs(axis.dot(up.in_world)), kMinDeviation);
      products += weight * axis * axis.transpose();
      sum += weight;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(products / sum);
    const double spread = std::sqrt(std::max(0.0, solver.eigenvalues()(1)));
    if (spread >= kMinAxesSpread) {
      up.in_world = solver.eigenvectors().col(0);
    } else {
      const Eigen::Vector3d axis = solver.eigenvectors().col(2);
      up.in_world = (mean_upper - mean_upper.dot(axis) * axis).normalized();
    }
    if (up.in_world.dot(mean_upper) < 0) up.in_world = -up.in_world;
  }
  std::vector<double> deviations;
  size_t num_upright = 0;
  for (size_t i = 0; i < axes.size(); ++i) {
    deviations.push_back(std::abs(M_PI_2 - Angle(axes[i], up.in_world)));
    // The upper side of a camera that looks straight down is anywhere.
    num_upright += uppers[i].dot(up.in_world) > -0.1;
  }
  if (!up.in_world.allFinite() ||
      ShareWithin(options.max_roll_deg * M_PI / 180, deviations) <
          options.min_share ||
      double(num_upright) < options.min_share * double(axes.size())) {
    return std::nullopt;
  }
  up.spread_rad = Median(deviations);
  return up;
}

}  // namespace

std::optional<UpDirection> FindUpDirection(
    const UpDirectionOptions& options,
    const std::vector<LevelCamera>& cameras) {
  if (cameras.size() < kMinNumCameras) return std::nullopt;
  if (const auto up = UpByGravity(options, cameras)) return up;
  return UpOfLevelCameras(options, cameras);
}

}  // namespace dgsfm
