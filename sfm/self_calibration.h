// Self-calibration of a complete model: which cameras are one and the same, and
// which principal points are to be trusted.

#pragma once

#include "sfm/bundle_adjustment.h"
#include "sfm/camera_groups.h"

#include <map>
#include <vector>

namespace dgsfm {

struct SelfCalibrationOptions {
  CameraGroupingOptions grouping;
  // Of the complete model, principal points free.
  BundleAdjustmentOptions bundle_adjustment;
  int num_threads = 1;
};

// Finds the groups of cameras and the principal points to hold in an adjusted
// model.
//
// Free intrinsics of few images have several minima, and linear errors tell
// them apart too well. So all cameras that may be the same by their focal
// lengths are tied first and the model is adjusted; one Gauss-Newton step from
// there shows which cameras still want to differ, and the groups are found anew
// from it, until they stay the same. The model is left at the adjustment with
// the groups found, or as it was where there are none, held principal points at
// the given ones.
//
// `beliefs` has no groups, and is returned with them. The gauge is held at
// fixed_image.
CameraBeliefs CalibrateModel(const SelfCalibrationOptions& options,
                             colmap::image_t fixed_image,
                             CameraBeliefs beliefs,
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
  // Of the parameters about the mean of the group; empty if they are the same.
  std::vector<double> group_stddevs;
};

std::map<colmap::camera_t, CameraResult> SummarizeCameras(
    const BundleAdjustmentOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
