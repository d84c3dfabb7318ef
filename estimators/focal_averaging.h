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

struct FocalEstimate {
  double focal_length_px = 0;
  double weight = 1;
};

// Weighted median of the logarithms and its weighted median absolute
// deviation; nothing if there are no estimates. Throws on estimates that are
// not finite and positive.
struct AveragedFocal {
  double focal_length_px = 0;
  // 1.4826 x weighted MAD of log focal lengths [1].
  double log_spread = 0;
};
std::optional<AveragedFocal> AverageFocals(
    const std::vector<FocalEstimate>& estimates);

// Fundamental matrix of a pair of cameras: x2^T F x1 = 0 for points in pixels
// relative to the principal points.
struct PairFundamental {
  int camera1 = 0;
  int camera2 = 0;
  Eigen::Matrix3d F = Eigen::Matrix3d::Zero();
  double weight = 1;
};

struct ViewGraphCalibrationOptions {
  // Cauchy scale of the normalised Kruppa residuals (Fetzer 2020) [1].
  double loss_scale = 0.01;
  int max_num_iterations = 100;
  // Estimates outside this ratio to their start are rejected.
  double min_focal_ratio = 0.1;
  double max_focal_ratio = 10.0;

  bool IsValid(std::string* error) const;
};

// Focal length per camera by minimising Fetzer's two residuals per pair over
// all unknown cameras at once (Fetzer, Reis, Stricker, WACV 2020). Cameras
// with known[i] keep focal_lengths[i]; others start there and return to it if
// the estimate is rejected. Returns per camera whether it was estimated.
std::vector<char> CalibrateViewGraph(const std::vector<PairFundamental>& pairs,
                                     const std::vector<char>& known,
                                     const ViewGraphCalibrationOptions& options,
                                     std::vector<double>* focal_lengths_px);

}  // namespace dgsfm
