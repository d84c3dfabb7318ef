// Bundle adjustment of a whole colmap::Reconstruction with priors on the
// intrinsics, which COLMAP 3.8's BundleAdjuster has no place for.

#pragma once

#include "colmap_ext/rig.h"
#include "estimators/optimization/center_prior.h"
#include "estimators/optimization/robust_loss.h"
#include "sfm/intrinsics/intrinsics_prior.h"
#include "sfm/verification/pair_verification.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace dgsfm {

struct BundleAdjustmentOptions {
  int max_num_iterations = 100;
  // Relative decrease of the cost by an iteration that ends it [1].
  double function_tolerance = 1e-5;
  // Residual from which the soft L1 loss grows linearly [px]; the mapper's
  // final adjustments use less where key points are accurate, see
  // AdaptedLossScales.
  double loss_scale_px = 0.5;
  // Scale of a Cauchy loss that replaces the soft L1 loss [px]. No option of
  // commands: the mapper sets it for errors with heavy tails.
  std::optional<double> cauchy_scale_px;
  IntrinsicsPriorOptions intrinsics;

  // The loss of errors in px.
  RobustLoss Loss() const;
  bool IsValid(std::string* error) const;
};

// How images are joined in bundle adjustment.
struct RigConstraints {
  FrameMembers frames;
  // Cameras whose pose in their rig is refined.
  std::set<colmap::camera_t> refined_cameras;
  // Whether the model has the unit of the rigs' baselines.
  bool fix_scale = false;
  // Whether the images, all of them at the origin, stay there and only turn.
  bool at_one_center = false;
};

// Where cameras are by other means, in the frame of the model.
struct CenterPriors {
  std::map<colmap::image_t, CenterPrior> centers;
  // Scale of their Cauchy loss [standard deviations].
  double loss_scale = 2;
};

// Scales of the loss by the errors of a model [px].
struct LossScales {
  double soft_l1_px = 0;
  // A Cauchy loss of this scale takes the place of the soft L1 loss.
  std::optional<double> cauchy_px;
};

// Reprojection errors of a model.
struct ReprojectionErrors {
  std::vector<double> all_px;
  // Errors by which tails are judged: those of points of three or more images.
  std::vector<double> of_tails_px;

  // `num_views` is the number of images that see the point.
  void Add(double error_px, size_t num_views);
};

// The soft L1 loss has 1.5 times the median reprojection error, at least a
// tenth of the scale of the options and at most that: errors of key points have
// long tails. Where their 90th percentile is more than 3.1 times the median, a
// Cauchy loss of the median takes its place; that is judged by the points of
// three or more images, if these have most of the observations. The scale of
// the options for a model without points.
LossScales AdaptedLossScales(const BundleAdjustmentOptions& options,
                             const ReprojectionErrors& errors);
LossScales AdaptedLossScales(const BundleAdjustmentOptions& options,
                             const colmap::Reconstruction& model);

// Whether a model has so many images that it may bend over its length by an
// angle that hardly shows in its errors. Adjustments then take curved steps
// that are hardly damped, and self-calibration judges distortions.
bool MayDrift(const colmap::Reconstruction& model);

// Minimises the robust reprojection errors of all observations and the squared
// deviations of intrinsics from what is believed (priors, and the means of the
// groups) over poses, points, intrinsics and means. Images of a frame move
// together. Prior centres, of which there must be three if any, add their costs
// and hold the model. Gauge without them: the pose of fixed_image or of its
// frame, and, where no rig fixes the scale, of the image farthest from it the
// coordinate of the translation that a change of scale moves most. Cameras
// whose images have hardly any observations keep their intrinsics. Returns the
// root of the mean robust squared error [px], or nothing if there is nothing to
// adjust or the solver failed. The same for any number of threads.
std::optional<double> AdjustBundle(const BundleAdjustmentOptions& options,
                                   int num_threads,
                                   colmap::image_t fixed_image,
                                   const CameraBeliefs& beliefs,
                                   colmap::Reconstruction* model,
                                   const RigConstraints& rigs = {},
                                   const CenterPriors& center_priors = {});

}  // namespace dgsfm
