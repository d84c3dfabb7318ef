// Self-calibration: which cameras are one and the same, and which principal
// points a model determines.

#pragma once

#include "sfm/intrinsics/camera_groups.h"
#include "sfm/mapping/bundle_adjustment.h"

#include <functional>
#include <map>
#include <vector>

namespace dgsfm {

// Adjusts a model with some beliefs, by at most so many iterations. Returns
// whether that succeeded.
using ModelAdjuster = std::function<bool(const CameraBeliefs& beliefs,
                                         int max_num_iterations,
                                         colmap::Reconstruction* model)>;

struct SelfCalibrationOptions {
  // Adjustment of the complete model, principal points free.
  BundleAdjustmentOptions bundle_adjustment;
  // Adjusts a model with these options.
  ModelAdjuster adjust;
  // Threads of the estimates of posteriors; -1 = all cores.
  int num_threads = 1;
};

// Ties all cameras of a kind in `beliefs`, unless they are too few in a large
// model for FindContradictingImages to judge them, and gives each group in the
// model the median focal length of its cameras.
void TieCameraClasses(const IntrinsicsPriorOptions& prior,
                      CameraBeliefs* beliefs,
                      colmap::Reconstruction* model);

// Images of a model adjusted with held principal points that contradict the
// intrinsics they share, see FindDeviatingImages.
std::vector<colmap::image_t> FindContradictingImages(
    const SelfCalibrationOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

// Frees the principal points that a model adjusted with held ones determines,
// see FindHeldPrincipalPoints, and holds distortions of a model that may drift,
// see FindHeldDistortions. The model is left at the adjustment with what is
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
};

std::map<colmap::camera_t, CameraResult> SummarizeCameras(
    const BundleAdjustmentOptions& options,
    int num_threads,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
