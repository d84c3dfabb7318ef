#include "estimators/averaging/median_rotation.h"

#include <algorithm>

#include <Eigen/Eigenvalues>

namespace dgsfm {

namespace {

// Each round weighs by the inverse of the angle to the average before.
constexpr int kNumRounds = 10;
constexpr double kMinAngle = 1e-9;  // [rad]

}  // namespace

Eigen::Quaterniond MedianRotation(
    const std::vector<Eigen::Quaterniond>& rotations) {
  Eigen::Quaterniond median = rotations.front();
  for (int round = 0; round < kNumRounds; ++round) {
    Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
    for (const Eigen::Quaterniond& rotation : rotations) {
      const double weight =
          round == 0
              ? 1
              : 1 / std::max(median.angularDistance(rotation), kMinAngle);
      sum += weight * rotation.coeffs() * rotation.coeffs().transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(sum);
    median.coeffs() = eigen.eigenvectors().col(3);
  }
  return median;
}

}  // namespace dgsfm
