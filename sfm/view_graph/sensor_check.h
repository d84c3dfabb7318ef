// Poses of cameras in their rigs against the relative poses of image pairs.

#pragma once

#include "colmap_ext/rig.h"
#include "sfm/mapping_context.h"

#include <vector>

namespace dgsfm {

// A camera whose rotation in its rig differs from what pairs show.
struct ContradictedSensor {
  colmap::camera_t camera_id = colmap::kInvalidCameraId;
  // Angle between the rotations, or in the median between the directions of
  // motion.
  double error_deg = 0;
  // What it was compared with: the camera of the rig with most in common.
  colmap::camera_t other_camera_id = colmap::kInvalidCameraId;
  bool by_motion = false;
};

// Cameras are compared by the images of frames that match each other or a third
// image, and where there are none, by the motions of both between two frames.
// The camera that contradicts most others leaves first, and is not compared any
// more; reference cameras stay. Errors of a few degrees pass: models find them.
std::vector<ContradictedSensor> FindContradictedSensors(
    const Scene& scene, const PairGeometries& pairs);

// Poses of cameras that pairs contradict become unknown, with a warning: such
// cameras are calibrated by the model.
void DropContradictedSensors(const PairGeometries& pairs,
                             Scene* scene,
                             MappingLog* log);

}  // namespace dgsfm
