// Cameras of a model that are one physical camera at one zoom, although each
// image came with its own.

#pragma once

#include "estimators/camera_grouping.h"
#include "sfm/intrinsics_posterior.h"

#include <vector>

namespace dgsfm {

// Groups of cameras of one camera model and image size that GroupCameras takes
// for the same from their adjusted intrinsics. Cameras with a prior focal
// length stay as the user gave them, in no group.
std::vector<CameraGroup> FindCameraGroups(const CameraGroupingOptions& options,
                                          const IntrinsicsPosterior& posterior,
                                          const colmap::Reconstruction& model);

}  // namespace dgsfm
