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
  // Their parameters one after the other [px, 1]: those of the model after a
  // Gauss-Newton step.
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

// Intrinsics one Gauss-Newton step from the model towards the minimum of
// AdjustBundle with the same arguments, and their covariance, poses and points
// unknown too: the inverse of the Schur complement of the soft-L1 costs and
// priors, times the variance of the estimates that the residuals show (Huber,
// Robust Statistics, Eq. 7.81), which priors are weighed against. Nothing if
// there are more images than a dense matrix allows, or no more observations
// than unknowns.
std::optional<IntrinsicsPosterior> EstimateIntrinsicsPosterior(
    const BundleAdjustmentOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
