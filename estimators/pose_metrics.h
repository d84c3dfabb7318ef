// Accuracy of estimated camera poses against ground truth.

#pragma once

#include "colmap_ext/rigid3.h"

#include <map>
#include <string>
#include <vector>

namespace dgsfm {

// Area under the recall curve up to each threshold [same unit as errors], in
// per cent: exact trapezoid over the sorted errors (SuperGlue/LoFTR formula).
// Infinite errors count as failures. Empty errors give 0.
std::vector<double> AreaUnderCurve(std::vector<double> errors,
                                   const std::vector<double>& thresholds);

struct PoseMetrics {
  size_t num_images = 0;      // in the ground truth
  size_t num_registered = 0;  // of those, in the model
  // Max of rotation and translation-direction error of every unordered pair
  // of ground-truth images [deg]; infinite if one is not registered.
  std::vector<double> relative_errors_deg;
  double median_rotation_error_deg = 0;
  double median_translation_error_deg = 0;
  // Similarity alignment of the centres, model to truth: factor that the
  // model must be multiplied with, and residual centre errors [truth units].
  // Zero with fewer than three common images.
  double truth_from_model_scale = 0;
  double rms_center_error = 0;
  double max_center_error = 0;
};

PoseMetrics EvaluatePoses(
    const std::map<std::string, Rigid3d>& truth_cam_from_world,
    const std::map<std::string, Rigid3d>& model_cam_from_world);

}  // namespace dgsfm
