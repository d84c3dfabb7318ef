// Bundle adjustment of a whole colmap::Reconstruction with priors on the
// intrinsics, which COLMAP 3.8's BundleAdjuster has no place for.

#pragma once

#include "colmap_ext/scene.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <optional>
#include <string>

namespace dgsfm {

struct BundleAdjustmentOptions {
  int max_num_iterations = 100;
  // Relative decrease of the cost by an iteration that ends it [1].
  double function_tolerance = 1e-4;
  // Residual from which the soft L1 loss grows linearly [px]: about twice the
  // noise of key points.
  double loss_scale_px = 0.5;
  bool refine_focal_length = true;
  bool refine_extra_params = true;
  // Only of cameras without a prior focal length: a given calibration keeps
  // its principal point.
  bool refine_principal_point = false;
  // Standard deviation of the principal point about that of the database, as a
  // share of the larger image side [1].
  double principal_point_stddev_ratio = 0.01;
  // Standard deviation of the distortion parameters about those of the database
  // [1].
  double extra_params_stddev = 0.1;
  // Standard deviation of key points that the priors are weighed against [px].
  double keypoint_stddev_px = 0.5;

  bool IsValid(std::string* error) const;
};

// `prior_cameras` are the cameras as the database has them. Minimises the
// soft-L1 reprojection errors of all observations and the squared deviations
// from the priors over poses, points and intrinsics. Gauge: the pose of
// fixed_image, and the largest coordinate of the translation of the image
// farthest from it. Cameras whose images have hardly any observations keep
// their intrinsics. Returns the root of the mean robust squared error [px], or
// nothing if there is nothing to adjust or the solver failed. The same for any
// number of threads.
std::optional<double> AdjustBundle(const BundleAdjustmentOptions& options,
                                   int num_threads,
                                   colmap::image_t fixed_image,
                                   const CameraMap& prior_cameras,
                                   colmap::Reconstruction* model);

}  // namespace dgsfm
