// Repeatability of a model, which needs no ground truth.

#pragma once

#include "estimators/pose_metrics.h"
#include "sfm/intrinsics/self_calibration.h"

#include <optional>

namespace dgsfm {

// Relative poses of two adjustments of a model, one with each half of its
// points and with cameras as free as `beliefs` has them: rotations and
// directions of translations of all pairs of images, those of one half as the
// truth. Points are halved by a hash of their ids. Errors that both halves have
// in common do not show. Nothing if an adjustment fails. The time is that of
// two adjustments and grows with the square of the number of images.
std::optional<PoseMetrics> SplitHalfRepeatability(
    const ModelAdjuster& adjust,
    int max_num_iterations,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
