// Whether the camera models of a model fit its images.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <optional>
#include <string>

namespace dgsfm {

// Mean reprojection errors along the radius, in rings around the image centre
// of an eighth of the half diagonal: what the distortion parameters leave over;
// and intrinsics that make up for a lens of another kind.
struct RadialErrors {
  // Largest absolute mean of a ring with at least a hundred observations [px].
  double max_mean_px = 0;
  // Medians over the images of the focal length and of the distance between
  // principal point and image centre, over the larger image side [1].
  double focal_ratio = 0;
  double center_offset_ratio = 0;
};
RadialErrors MeasureRadialErrors(const colmap::Reconstruction& model);

// Sentence that names a camera model to try; nothing if there is no need.
std::optional<std::string> CameraModelAdvice(const RadialErrors& errors);

}  // namespace dgsfm
