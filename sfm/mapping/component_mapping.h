// From a connected part of the view graph to a model.

#pragma once

#include "estimators/pose_metrics.h"
#include "sfm/georeferencing/model_alignment.h"
#include "sfm/intrinsics/self_calibration.h"
#include "sfm/mapping_context.h"
#include "sfm/view_graph/component_averaging.h"

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

namespace dgsfm {

struct ComponentResult {
  // Null if mapping failed or too few images are left.
  std::unique_ptr<colmap::Reconstruction> model;
  std::map<colmap::camera_t, CameraResult> cameras;
  // Why each image of the component that the model lacks is missing.
  std::map<colmap::image_t, std::string> unregistered_images;
  // Factors of the depth maps of registered images against the model.
  std::map<colmap::image_t, double> depth_scales;
  ModelGeoreference georeference;
  // Cameras whose pose in their rig is that of the model.
  std::set<colmap::camera_t> refined_sensors;
  std::optional<PoseMetrics> repeatability;
};

// Maps images with averaged rotations: averages scales and centres, establishes
// tracks, positions and adjusts the images, calibrates the cameras, completes
// the tracks and scales the model. Pairs that leave, or come back, get their
// status; those of other images stay as they are, so that components can be
// mapped in any order.
ComponentResult MapComponent(const MappingContext& context,
                             const ComponentRotations& rotations,
                             bool measure_repeatability,
                             PairGeometries* pairs,
                             MappingLog* log);

}  // namespace dgsfm
