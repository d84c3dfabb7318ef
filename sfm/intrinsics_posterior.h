// How well a model determines the intrinsics of its cameras.

#pragma once

#include "sfm/bundle_adjustment.h"

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct IntrinsicsPosterior {
  // Ascending; of a rigid group only the first.
  std::vector<colmap::camera_t> camera_ids;
  // Their parameters one after the other [px, 1].
  Eigen::VectorXd params;
  // Of the data and the priors. Zero for parameters that are held.
  Eigen::MatrixXd covariance;
  // Scale of the image errors, from the residuals [px].
  double keypoint_stddev_px = 0;

  // Standard deviations of the parameters of a camera; empty if it has no
  // observations.
  Eigen::VectorXd StddevsOf(colmap::camera_t camera_id,
                            const colmap::Reconstruction& model) const;
};

// Covariance of all intrinsics at the minimum of AdjustBundle with the same
// arguments, poses and points unknown too: the inverse of the Schur complement
// of the soft-L1 costs and priors, times the variance of the estimates that the
// residuals show (Huber, Robust Statistics, Eq. 7.81). Nothing if there are
// more images than a dense matrix allows, or no more observations than
// unknowns. Groups that are not rigid are not taken into account.
std::optional<IntrinsicsPosterior> EstimateIntrinsicsPosterior(
    const BundleAdjustmentOptions& options,
    const CameraMap& prior_cameras,
    const std::vector<CameraGroup>& groups,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
