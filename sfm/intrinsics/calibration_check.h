// Whether given intrinsics belong to the images that they are given for.

#pragma once

#include "colmap_ext/scene.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

// Sentences about cameras whose principal point is that of another image size,
// or has its coordinates exchanged, as far as a centred one shows that. One
// sentence for all cameras with the same fault.
std::vector<std::string> PrincipalPointAdvice(const CameraMap& cameras);

// Sentence about calibrated focal lengths that adjustment moved by several
// standard deviations of their prior; nothing if there are none.
std::optional<std::string> CalibratedFocalAdvice(
    double focal_length_stddev_ratio,
    const CameraMap& given,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
