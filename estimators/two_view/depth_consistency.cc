#include "estimators/two_view/depth_consistency.h"

#include "colmap_ext/check.h"
#include "estimators/option_check.h"
#include "estimators/two_view/two_view_residuals.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

// Depth maps mark holes by zero, infinity or NaN.
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
  // A tolerance of zero leaves a segment without length.
  const double along =
      -begin.dot(segment) / std::max(segment.squaredNorm(), 1e-300);
  return (begin + std::min(std::max(along, 0.0), 1.0) * segment).norm();
}

}  // namespace

bool DepthConsistencyOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Above("DepthConsistency.max_reprojection_error",
             max_reprojection_error_px,
             0)
      .Above("max_depth_error_ratio", max_depth_error_ratio, 0)
      .AreKept();
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

  // Whether the point of one view lands near the other, at the right depth.
  const auto passes = [&options](const TwoViewModel& from_to,
                                 const Eigen::Vector2d& x1,
                                 double depth1,
                                 const Eigen::Vector2d& x2,
                                 double depth2) {
    Transfer transfer;
    return TransferMatch(from_to, x1, depth1, x2, depth2, &transfer) &&
           DistanceToDepthRange(transfer,
                                from_to.focal2,
                                options.tolerate_depth_error
                                    ? options.max_depth_error_ratio
                                    : 0) < options.max_reprojection_error_px &&
           std::abs(std::expm1(transfer.log_depth_ratio)) <
               options.max_depth_error_ratio;
  };
  const TwoViewModel inverse = model.Inverse();
  std::vector<DepthVerdict> verdicts(size, DepthVerdict::UNTESTED);
  for (size_t i = 0; i < size; ++i) {
    const Eigen::Vector2d& x1 = matches.points1[i];
    const Eigen::Vector2d& x2 = matches.points2[i];
    const double depth1 = matches.depths1[i];
    const double depth2 = matches.depths2[i];
    if (!IsUsable(depth1) || !IsUsable(depth2)) continue;
    verdicts[i] = passes(model, x1, depth1, x2, depth2) &&
                          passes(inverse, x2, depth2, x1, depth1)
                      ? DepthVerdict::CONSISTENT
                      : DepthVerdict::INCONSISTENT;
  }
  return verdicts;
}

}  // namespace dgsfm
