// The frame and unit of a model by positions that its cameras are known to
// have, e.g. by GPS.

#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

// x_in_target = scale * rotation * x_in_source + translation.
struct Similarity3d {
  double scale = 1;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Similarity3d Inverse() const;
};

Eigen::Vector3d operator*(const Similarity3d& target_from_source,
                          const Eigen::Vector3d& x_in_source);

// A position in both frames.
struct PositionMatch {
  Eigen::Vector3d source = Eigen::Vector3d::Zero();
  Eigen::Vector3d target = Eigen::Vector3d::Zero();
  // L of the information L^T L of the target position [1 / target unit].
  Eigen::Matrix3d target_sqrt_information = Eigen::Matrix3d::Identity();
};

// A direction in both frames: what holds the rotation about the line that
// positions may be on.
struct DirectionMatch {
  Eigen::Vector3d source = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d target = Eigen::Vector3d::UnitZ();
  double stddev_rad = 1;
};

struct PositionAlignmentOptions {
  int num_trials = 500;
  int max_num_iterations = 50;
  // Scale of the Cauchy loss [standard deviations].
  double loss_scale = 2.0;
  // Errors of an inlier [standard deviations].
  double max_error = 3.5;
  // Scale that is not estimated, if given [1].
  std::optional<double> fixed_scale;
};

struct PositionAlignment {
  Similarity3d target_from_source;
  // By the covariance of the solution, times the spread where that is above 1.
  double log_scale_stddev = 0;
  // Standard deviation about the least certain axis [rad].
  double rotation_stddev_rad = 0;
  // Spread of normally distributed errors with the median of those found
  // [standard deviations].
  double spread = 0;
  // Error of each match [standard deviations], and whether it agrees.
  std::vector<double> errors;
  std::vector<bool> is_inlier;
  size_t num_inliers = 0;
};

// The similarity that takes most source positions near their targets: that of
// three matches whose 55th percentile of errors is smallest, then refined by
// iteratively reweighted least squares with a Cauchy loss whose scale follows
// the errors. Up to 40 % of the matches may be wrong. `up` leaves the
// positions the last word where they hold the rotation. Nothing for fewer than
// three matches, or if either side has no extent. Deterministic.
std::optional<PositionAlignment> AlignPositions(
    const PositionAlignmentOptions& options,
    const std::vector<PositionMatch>& matches,
    const std::optional<DirectionMatch>& up);

// The most matches that agree with the similarity of three of them.
size_t CountAgreeing(const PositionAlignmentOptions& options,
                     const std::vector<PositionMatch>& matches,
                     const std::optional<DirectionMatch>& up);

// The same spread of the errors of positions that are in one frame already.
double SpreadOfErrors(const std::vector<double>& errors);

}  // namespace dgsfm
