#include "estimators/pose_metrics.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace dgsfm {
namespace {

constexpr double kDegFromRad = 180.0 / M_PI;

// Shorter baselines have no direction [units of the model].
constexpr double kMinBaseline = 1e-9;

double RotationErrorDeg(const Rigid3d& truth, const Rigid3d& model) {
  return kDegFromRad * truth.rotation.angularDistance(model.rotation);
}

// A pair without true baseline cannot be wrong; one that has a true baseline
// but none in the model is as wrong as can be.
double DirectionErrorDeg(const Eigen::Vector3d& truth,
                         const Eigen::Vector3d& model) {
  if (truth.norm() < kMinBaseline) return 0;
  if (model.norm() < kMinBaseline) return 180;
  return kDegFromRad * std::atan2(truth.cross(model).norm(), truth.dot(model));
}

// Columns of both are corresponding centres.
void EvaluateCenters(const Eigen::Matrix3Xd& truth,
                     const Eigen::Matrix3Xd& model,
                     PoseMetrics* metrics) {
  const Eigen::Matrix3Xd centered_model =
      model.colwise() - model.rowwise().mean();
  Eigen::Matrix3Xd aligned = truth.rowwise().mean().replicate(1, truth.cols());
  if (centered_model.squaredNorm() > 0) {
    const Eigen::Matrix4d truth_from_model = Eigen::umeyama(model, truth);
    metrics->truth_from_model_scale = truth_from_model.col(0).norm();
    aligned = (truth_from_model.topLeftCorner<3, 3>() * model).colwise() +
              truth_from_model.topRightCorner<3, 1>();
  }
  const Eigen::RowVectorXd squared_errors =
      (aligned - truth).colwise().squaredNorm();
  metrics->rms_center_error = std::sqrt(squared_errors.mean());
  metrics->max_center_error = std::sqrt(squared_errors.maxCoeff());
}

}  // namespace

std::vector<double> AreaUnderCurve(std::vector<double> errors,
                                   const std::vector<double>& thresholds) {
  std::sort(errors.begin(), errors.end());
  std::vector<double> areas;
  for (const double threshold : thresholds) {
    DGSFM_CHECK(threshold > 0) << "threshold = " << threshold;
    // Recall rises linearly from error to error and stays level from the last
    // one below the threshold.
    double area = 0;
    double last_error = 0;
    double last_recall = 0;
    for (size_t i = 0; i < errors.size() && errors[i] < threshold; ++i) {
      const double recall = static_cast<double>(i + 1) / errors.size();
      area += (errors[i] - last_error) * 0.5 * (recall + last_recall);
      last_error = errors[i];
      last_recall = recall;
    }
    area += (threshold - last_error) * last_recall;
    areas.push_back(100 * area / threshold);
  }
  return areas;
}

PoseMetrics EvaluatePoses(
    const std::map<std::string, Rigid3d>& truth_cam_from_world,
    const std::map<std::string, Rigid3d>& model_cam_from_world) {
  std::vector<std::pair<Rigid3d, Rigid3d>> common;  // truth, model
  for (const auto& [name, truth] : truth_cam_from_world) {
    const auto model = model_cam_from_world.find(name);
    if (model == model_cam_from_world.end()) continue;
    common.emplace_back(truth, model->second);
  }
  PoseMetrics metrics;
  metrics.num_images = truth_cam_from_world.size();
  metrics.num_registered = common.size();

  std::vector<double> rotation_errors, direction_errors;
  for (size_t i = 0; i < common.size(); ++i) {
    for (size_t j = i + 1; j < common.size(); ++j) {
      const Rigid3d truth = common[j].first * common[i].first.Inverse();
      const Rigid3d model = common[j].second * common[i].second.Inverse();
      rotation_errors.push_back(RotationErrorDeg(truth, model));
      direction_errors.push_back(
          DirectionErrorDeg(truth.translation, model.translation));
      metrics.relative_errors_deg.push_back(
          std::max(rotation_errors.back(), direction_errors.back()));
    }
  }
  const size_t num_pairs =
      metrics.num_images * (metrics.num_images - 1) / 2;  // 0 for 0 images
  // Pairs with an image that is missing in the model.
  metrics.relative_errors_deg.resize(num_pairs,
                                     std::numeric_limits<double>::infinity());
  if (!rotation_errors.empty()) {
    metrics.median_rotation_error_deg = Median(std::move(rotation_errors));
    metrics.median_translation_error_deg = Median(std::move(direction_errors));
  }

  if (common.size() >= 3) {
    Eigen::Matrix3Xd truth_centers(3, common.size());
    Eigen::Matrix3Xd model_centers(3, common.size());
    for (size_t i = 0; i < common.size(); ++i) {
      truth_centers.col(i) = common[i].first.TargetOriginInSource();
      model_centers.col(i) = common[i].second.TargetOriginInSource();
    }
    EvaluateCenters(truth_centers, model_centers, &metrics);
  }
  return metrics;
}

}  // namespace dgsfm
