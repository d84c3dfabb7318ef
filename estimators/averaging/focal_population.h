// Focal lengths of cameras of one kind, drawn towards each other.

#pragma once

#include <vector>

namespace dgsfm {

// Median of the estimates of one camera.
struct CameraFocalEstimate {
  double log_focal_length = 0;
  // Spread of the estimates about their average [1], >= 0.
  double log_spread = 0;
  // 0 if there is no estimate; the fields above are then ignored.
  int num_estimates = 0;
};

// Draws each camera's log focal length x_i towards the median m of all, the
// more, the less the cameras differ (empirical Bayes, Efron and Morris 1975):
//   (x_i / v_i + m / t^2) / (1 / v_i + 1 / t^2).
// v_i is the variance of x_i, a median of num_estimates whose spread is at
// least the median one of all cameras; t^2 what the robust variance of the x_i
// exceeds the median of the v_i by. Cameras without estimates get m. Where
// cameras are one and the same, t is small and all get m; where they differ,
// they keep what they have. Empty if fewer than four have estimates. Throws on
// values that are not finite. Deterministic.
std::vector<double> ShrinkLogFocals(
    const std::vector<CameraFocalEstimate>& estimates);

}  // namespace dgsfm
