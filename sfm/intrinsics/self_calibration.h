// Self-calibration: which cameras are one and the same, and which principal
// points a model determines.

#pragma once

#include "sfm/intrinsics/camera_groups.h"
#include "sfm/mapping/bundle_adjustment.h"

#include <functional>
#include <map>
#include <optional>
#include <vector>

namespace dgsfm {

// Adjusts a model with some beliefs, by at most so many iterations. Returns
// whether that succeeded.
using ModelAdjuster = std::function<bool(const CameraBeliefs& beliefs,
                                         int max_num_iterations,
                                         colmap::Reconstruction* model)>;

struct SelfCalibrationOptions {
  CameraGroupingOptions grouping;
  // Whether groups are looked for among cameras that are in none.
  bool tie_cameras = true;
  // Adjustment of the complete model, principal points free.
  BundleAdjustmentOptions bundle_adjustment;
  // Adjusts a model with these options.
  ModelAdjuster adjust;
};

// Ties all cameras of a kind in `beliefs` and gives each group in the model the
// median focal length of its cameras.
void TieCameraClasses(const IntrinsicsPriorOptions& prior,
                      CameraBeliefs* beliefs,
                      colmap::Reconstruction* model);

// Images of a model adjusted with held principal points that contradict the
// intrinsics they share, see FindDeviatingImages.
std::vector<colmap::image_t> FindContradictingImages(
    const SelfCalibrationOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

// Finds groups among the cameras that are in none, and the principal points to
// hold, in a model adjusted with held principal points.
//
// Free intrinsics of few images have several minima, and linear errors tell
// them apart too well. So cameras whose focal lengths are close are tied first
// and the model is adjusted; one Gauss-Newton step from there shows which
// cameras still want to differ, and the groups are found anew from it, until
// they stay the same.
//
// Principal points are freed where the model determines them, see
// FindHeldPrincipalPoints. The model is left at the adjustment with what is
// returned, or as it was, with all principal points held, where nothing was
// learned, an adjustment failed, or cameras became implausible.
CameraBeliefs CalibrateModel(const SelfCalibrationOptions& options,
                             const CameraBeliefs& beliefs,
                             colmap::Reconstruction* model);

// Intrinsics of a camera in its model, parameters in COLMAP's order [px, 1].
struct CameraResult {
  std::vector<double> params;
  // Standard deviations of the database's values, 0 where held and infinite
  // where there is no prior, and of `params`; empty where not known.
  std::vector<double> prior_stddevs;
  std::vector<double> stddevs;
  // Smallest camera id of its group, or its own.
  colmap::camera_t group = colmap::kInvalidCameraId;
  // Standard deviations of the parameters about the mean of the group; empty if
  // they are the same.
  std::vector<double> group_stddevs;
};

std::map<colmap::camera_t, CameraResult> SummarizeCameras(
    const BundleAdjustmentOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
