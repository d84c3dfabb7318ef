#include "estimators/two_view/depth_consistency.h"

#include "colmap_ext/check.h"
#include "estimators/two_view/two_view_residuals.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace dgsfm {
namespace {

bool IsUsable(double depth) { return depth > 0 && std::isfinite(depth); }

// Distance [px] of the matched image point from the projections of the
// transferred point as its depth varies by the ratio, either way. An end of the
// range behind the camera is replaced by the point itself.
double DistanceToDepthRange(const Transfer& transfer,
                            double focal_length_px,
                            double depth_error_ratio) {
  const auto error_at = [&](double ratio) -> Eigen::Vector2d {
    const Eigen::Vector3d point = transfer.point + ratio * transfer.ray;
    if (!(point.z() > 0)) return transfer.error_px;
    return transfer.error_px + focal_length_px * (point.hnormalized() -
                                                  transfer.point.hnormalized());
  };
  const Eigen::Vector2d begin = error_at(-depth_error_ratio);
  const Eigen::Vector2d segment = error_at(depth_error_ratio) - begin;
  const double along =
      -begin.dot(segment) / std::max(segment.squaredNorm(), 1e-300);
  return (begin + std::min(std::max(along, 0.0), 1.0) * segment).norm();
}

// A transfer against the covariance of its errors; with j the derivative of the
// projection by the log depth and a that of the log of the transferred depth,
//   across the epipolar line: 2 px^2,
//   along it and log depth ratio: [2 px^2 + |j|^2 sd^2, |j| a sd^2;
//                                  ., (1 + a^2) sd^2].
struct TransferTest {
  bool position_agrees = false;
  bool depth_agrees = false;
  bool in_front = false;  // of the surface that the other map shows

  TransferTest(const Transfer& transfer,
               double focal_length_px,
               const DepthConsistencyOptions& options) {
    constexpr double kMaxSqDeviation = 9;
    const double sq_px = 2 * options.stddev_px * options.stddev_px;
    const double sq_depth = options.log_depth_stddev * options.log_depth_stddev;
    const double inverse_z = 1 / transfer.point.z();
    const double slope = transfer.ray.z() * inverse_z;
    const Eigen::Vector2d shift =
        focal_length_px * inverse_z *
        (transfer.ray.head<2>() - slope * transfer.point.head<2>());
    const double length = shift.norm();
    const Eigen::Vector2d direction =
        length > 0 ? Eigen::Vector2d(shift / length) : Eigen::Vector2d::UnitX();
    const double along = direction.dot(transfer.error_px);
    const double sq_across =
        std::max(transfer.error_px.squaredNorm() - along * along, 0.0);
    // Where along the line is a matter of depth.
    position_agrees = sq_across < kMaxSqDeviation * sq_px;
    Eigen::Matrix2d covariance;
    covariance << sq_px + length * length * sq_depth, length * slope * sq_depth,
        length * slope * sq_depth, (1 + slope * slope) * sq_depth;
    const Eigen::Vector2d residual(along, transfer.log_depth_ratio);
    depth_agrees =
        residual.dot(covariance.inverse() * residual) < kMaxSqDeviation;
    in_front = transfer.log_depth_ratio < 0;
  }
};

DepthVerdict CombineTests(const TransferTest& forward,
                          const TransferTest& backward) {
  if (!forward.position_agrees || !backward.position_agrees) {
    return DepthVerdict::INCONSISTENT;
  }
  if (forward.depth_agrees && backward.depth_agrees) {
    return DepthVerdict::CONSISTENT;
  }
  return forward.in_front && backward.in_front ? DepthVerdict::INCONSISTENT
                                               : DepthVerdict::OCCLUDED;
}

}  // namespace

bool DepthConsistencyOptions::IsValid(std::string* error) const {
  bool ok = true;
  const auto check = [&](double value, const char* name) {
    if (value > 0) return;
    ok = false;
    if (error) {
      *error +=
          std::string(name) + " = " + std::to_string(value) + " must be > 0\n";
    }
  };
  check(max_reprojection_error_px, "max_reprojection_error_px");
  check(max_depth_error_ratio, "max_depth_error_ratio");
  check(stddev_px, "stddev_px");
  if (!(log_depth_stddev >= 0)) {
    ok = false;
    if (error) {
      *error += "log_depth_stddev = " + std::to_string(log_depth_stddev) +
                " must be >= 0\n";
    }
  }
  return ok;
}

std::vector<DepthVerdict> CheckDepthConsistency(
    const DepthMatches& matches,
    const Rigid3d& cam2_from_cam1,
    double scale_1_from_2,
    double focal_length1_px,
    double focal_length2_px,
    const DepthConsistencyOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(scale_1_from_2 > 0) << "scale_1_from_2 = " << scale_1_from_2;
  DGSFM_CHECK(focal_length1_px > 0 && focal_length2_px > 0)
      << focal_length1_px << ", " << focal_length2_px;
  const size_t size = matches.points1.size();
  DGSFM_CHECK(matches.points2.size() == size &&
              matches.depths1.size() == size && matches.depths2.size() == size);

  TwoViewModel model;
  model.rotation = cam2_from_cam1.rotation.normalized().toRotationMatrix();
  model.translation = cam2_from_cam1.translation;
  model.scale = scale_1_from_2;
  model.focal1 = focal_length1_px;
  model.focal2 = focal_length2_px;

  const double depth_tolerance =
      options.tolerate_depth_error ? options.max_depth_error_ratio : 0;
  const auto passes = [&](const Transfer& transfer, double focal_length_px) {
    return DistanceToDepthRange(transfer, focal_length_px, depth_tolerance) <
               options.max_reprojection_error_px &&
           std::abs(std::expm1(transfer.log_depth_ratio)) <
               options.max_depth_error_ratio;
  };
  std::vector<DepthVerdict> verdicts(size, DepthVerdict::UNTESTED);
  for (size_t i = 0; i < size; ++i) {
    if (!IsUsable(matches.depths1[i]) || !IsUsable(matches.depths2[i])) {
      continue;
    }
    Transfer forward, backward;
    const auto transfer = [&](TransferDirection direction, Transfer* result) {
      return TransferMatch(direction,
                           model,
                           matches.points1[i],
                           matches.depths1[i],
                           matches.points2[i],
                           matches.depths2[i],
                           result);
    };
    if (!transfer(TransferDirection::FORWARD, &forward) ||
        !transfer(TransferDirection::BACKWARD, &backward)) {
      verdicts[i] = DepthVerdict::INCONSISTENT;
    } else if (options.log_depth_stddev > 0) {
      verdicts[i] = CombineTests(TransferTest(forward, model.focal2, options),
                                 TransferTest(backward, model.focal1, options));
    } else {
      const bool consistent =
          passes(forward, model.focal2) && passes(backward, model.focal1);
      verdicts[i] =
          consistent ? DepthVerdict::CONSISTENT : DepthVerdict::INCONSISTENT;
    }
  }
  return verdicts;
}

}  // namespace dgsfm
