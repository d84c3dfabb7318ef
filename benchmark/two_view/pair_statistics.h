// What the accuracy harnesses print of a set of image pairs: one line of a
// Markdown table.

#pragma once

#include "estimators/pose_metrics.h"
#include "tests/estimators/two_view_scene.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

namespace dgsfm {

// Errors of single parameters in units of their standard deviation.
class Calibration {
 public:
  void Add(double error, double variance) {
    if (!(variance > 0)) return;
    ++num_total_;
    num_within_ += error * error < 4 * variance;
  }
  // Share within two standard deviations (a Gaussian has 95.4 %).
  std::string Percent() const {
    if (num_total_ == 0) return "";
    return std::to_string(std::lround(100.0 * num_within_ / num_total_));
  }

 private:
  int num_total_ = 0;
  int num_within_ = 0;
};

class PairStatistics {
 public:
  static void PrintHeader(const char* first_column) {
    std::printf(
        "| %s | median | AUC 5 / 10 / 20 | log s | focal | 2 sigma R t s f | "
        "ms | trials |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n",
        first_column);
  }

  void Add(const TwoViewDepthResult& result,
           const TwoViewModel& truth,
           bool scale_is_known,
           double milliseconds) {
    const TwoViewErrors errors = CompareWithTruth(result, truth);
    pose_deg_.push_back(result.success ? errors.PoseDeg() : 180);
    if (scale_is_known) log_scale_.push_back(errors.log_scale);
    focal_.push_back(errors.focal_ratio);
    milliseconds_ += milliseconds;
    num_trials_ += result.num_trials;
    if (result.has_covariance && scale_is_known) AddCalibration(result, truth);
  }

  void Print(const std::string& name) const {
    const std::vector<double> areas = AreaUnderCurve(pose_deg_, {5, 10, 20});
    const double size = static_cast<double>(pose_deg_.size());
    std::printf(
        "| %s | %.2f | %.1f / %.1f / %.1f | %.3f | %.3f | %s %s %s %s | %.2f | "
        "%.0f |\n",
        name.c_str(),
        MedianOf(pose_deg_),
        areas[0],
        areas[1],
        areas[2],
        log_scale_.empty() ? 0 : MedianOf(log_scale_),
        MedianOf(focal_),
        rotation_.Percent().c_str(),
        translation_.Percent().c_str(),
        scale_.Percent().c_str(),
        focals_.Percent().c_str(),
        milliseconds_ / size,
        num_trials_ / size);
    std::fflush(stdout);
  }

 private:
  void AddCalibration(const TwoViewDepthResult& result,
                      const TwoViewModel& truth) {
    const Eigen::AngleAxisd rotation(
        truth.rotation *
        result.cam2_from_cam1.rotation.conjugate().toRotationMatrix());
    const Eigen::Vector3d rotation_error = rotation.angle() * rotation.axis();
    const auto variances = result.covariance.diagonal();
    for (int k = 0; k < 3; ++k) {
      rotation_.Add(rotation_error(k), variances(k));
      translation_.Add(
          result.cam2_from_cam1.translation(k) - truth.translation(k),
          variances(3 + k));
    }
    scale_.Add(std::log(result.scale_1_from_2 / truth.scale), variances(6));
    focals_.Add(std::log(result.focal_length1_px / truth.focal1), variances(7));
    focals_.Add(std::log(result.focal_length2_px / truth.focal2), variances(8));
  }

  std::vector<double> pose_deg_, log_scale_, focal_;
  Calibration rotation_, translation_, scale_, focals_;
  double milliseconds_ = 0;
  double num_trials_ = 0;
};

// The result and the processor time it took.
inline TwoViewDepthResult EstimateTimed(const TwoViewDepthInput& input,
                                        const TwoViewDepthOptions& options,
                                        double* milliseconds) {
  const std::clock_t begin = std::clock();
  const TwoViewDepthResult result =
      EstimateTwoViewGeometryWithDepth(input, options);
  *milliseconds = 1e3 * static_cast<double>(std::clock() - begin) /
                  static_cast<double>(CLOCKS_PER_SEC);
  return result;
}

}  // namespace dgsfm
