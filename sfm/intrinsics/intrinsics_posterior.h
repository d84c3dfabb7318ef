// How well a model determines the intrinsics of its cameras.

#pragma once

#include "sfm/mapping/bundle_adjustment.h"

#include <map>
#include <optional>

#include <Eigen/Core>

namespace dgsfm {

// Models of more images are judged by so many of them.
constexpr size_t kMaxNumPosteriorImages = 200;

// Which images share intrinsics.
enum class IntrinsicsBlocks {
  BY_CAMERA,  // those of a camera, and those of the cameras of a group
  BY_IMAGE,   // none: each image determines its own
};

struct IntrinsicsPosterior {
  // First parameter of the intrinsics of each camera, of a group those of its
  // first one, or of each image.
  std::map<uint32_t, Eigen::Index> first_params;
  // Images of each block that the posterior rests on.
  std::map<uint32_t, int> num_images;
  // Parameters of one block after the other [px, 1]: those of the model after a
  // Gauss-Newton step.
  Eigen::VectorXd params;
  // Under realistic errors of the images and the priors, and the part of it
  // that errors of single key points cause. Zero for parameters that are held.
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd keypoint_covariance;
};

// Intrinsics one Gauss-Newton step from the model towards the minimum of
// AdjustBundle with the same arguments, and their covariance, poses and points
// unknown too.
//
// The covariance has two parts:
// - errors of single key points: the inverse of the Schur complement of the
//   soft-L1 costs and priors, times the variance of the estimates that the
//   residuals show (Huber, Robust Statistics, Eq. 7.81), which priors are
//   weighed against; each standard deviation at least that of the sandwich
//   estimator whose clusters are points, since errors of one track have causes
//   in common (Huber, Sec. 7.6);
// - smooth errors of whole images, which more key points do not average out
//   (lens distortion beyond the camera model, rolling shutter, image
//   stabilisation, bias of detectors): quadratic and cubic polynomials of the
//   image coordinates, in each image independent ones and one in common for
//   all images of a block, each coefficient with a standard deviation of
//   2e-4 times the larger image side (0.3 px of 1600 px) at half that side
//   from the centre.
//
// Models of more than max_num_images images are judged by so many of them,
// those that share the most points. Nothing if there are no more observations
// than unknowns. The same for any number of threads.
std::optional<IntrinsicsPosterior> EstimateIntrinsicsPosterior(
    const BundleAdjustmentOptions& options,
    int num_threads,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model,
    IntrinsicsBlocks blocks = IntrinsicsBlocks::BY_CAMERA,
    size_t max_num_images = kMaxNumPosteriorImages);

}  // namespace dgsfm
