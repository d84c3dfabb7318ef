// Focal lengths of the cameras from what the pairs estimated.

#pragma once

#include "sfm/view_graph/view_graph.h"

#include <map>
#include <string>

namespace dgsfm {

enum class FocalSource {
  PRIOR,            // given by the user: untouched
  PAIRS,            // median of the depth-aware pair estimates (DGSfM Sec. 3.3)
  EXIF,             // as the camera wrote it into the image
  SIMILAR_CAMERAS,  // median of cameras of the same kind
  DEFAULT,          // no evidence: the value in the database
};

std::string FocalSourceName(FocalSource source);

struct CameraFocal {
  FocalSource source = FocalSource::DEFAULT;
  double focal_length_px = 0;
  size_t num_estimates = 0;
  // Spread of these estimates of log focal length [1].
  double log_spread = 0;
};

// Sets the focal length of every camera without a prior focal length from the
// valid pairs: the median over all images of the camera, averaged with EXIF's
// where the two agree; without estimates that of EXIF; where there is none
// either, the value stays. With relate_cameras, estimates of cameras of one
// kind are drawn towards each other, and cameras without evidence get the
// median of their kind, see ShrinkLogFocals.
std::map<colmap::camera_t, CameraFocal> AverageFocalsOfCameras(
    const PairGeometries& pairs, bool relate_cameras, Scene* scene);

}  // namespace dgsfm
