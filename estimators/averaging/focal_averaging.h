// One focal length per camera from the estimates of its image pairs (DGSfM
// Sec. 3.3, "Focal Averaging"), and from fundamental matrices where no depth
// is at hand.

#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Median of the logarithms of focal lengths [px] and their spread; nothing if
// there are none. Throws on values that are not finite and positive.
struct AveragedFocal {
  double focal_length_px = 0;
  // 1.4826 x MAD of log focal lengths [1].
  double log_spread = 0;
};
std::optional<AveragedFocal> AverageFocals(
    const std::vector<double>& focal_lengths_px);

// Fundamental matrix of a pair of cameras: x2^T F x1 = 0 for points in pixels
// relative to the principal points.
struct PairFundamental {
  // The same index twice for a pair of images of one camera.
  int camera1 = 0;
  int camera2 = 0;
  Eigen::Matrix3d F = Eigen::Matrix3d::Zero();
};

struct ViewGraphCalibrationOptions {
  // Cauchy scale of the normalised Kruppa residuals [1] (Fetzer 2020).
  double loss_scale = 0.01;
  int max_num_iterations = 100;
  // Standard deviation of the prior of log focal lengths about their start [1],
  // weighed against residuals of standard deviation loss_scale: it decides
  // where the pairs leave focal lengths open, as those of a camera that moves
  // forward.
  double start_log_stddev = 0.5;
  // Estimates outside this ratio to their start are rejected.
  double min_focal_ratio = 0.1;
  double max_focal_ratio = 10.0;

  bool IsValid(std::string* error) const;
};

// Focal length per camera from Kruppa's equations of all pairs at once, with
// a Cauchy loss (after Fetzer, Reis, Stricker, WACV 2020).
//
// With W_i = diag(f_i^2, f_i^2, 1), the images of the dual absolute conic,
// F W_1 F^T and [e_2]x W_2 [e_2]x^T are proportional. The residual of a pair
// is the difference of the two as symmetric 2 x 2 matrices in the left
// singular basis of F, each divided by its Frobenius norm [1]; coordinates are
// in units of the start's focal lengths. Fetzer instead solves two of the
// equations for a focal length each: this divides by small numbers for weak
// pairs, and has a root of its own where both matrices become diagonal. (Ten
// cameras, 30 pairs, 1 px of noise, 20 scenes: median error 0.15 % instead of
// 0.29 %, largest 1 % instead of 48 %.)
//
// Degenerate where optical axes meet in one point or are parallel throughout:
// focal lengths then stay near their start or run to the bounds.
//
// Cameras with known[i] keep focal_lengths_px[i]; others start there and
// return to it if the estimate is rejected. Returns per camera whether it was
// estimated: none if the solver fails. Throws on indices out of range, focal
// lengths that are not finite and positive, and on F that is zero
// or not finite. Deterministic.
std::vector<char> CalibrateViewGraph(const std::vector<PairFundamental>& pairs,
                                     const std::vector<char>& known,
                                     const ViewGraphCalibrationOptions& options,
                                     std::vector<double>* focal_lengths_px);

}  // namespace dgsfm
