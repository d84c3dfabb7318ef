#include "sfm/bundle_adjustment.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/bundle_solver.h"
#include "estimators/option_check.h"
#include "sfm/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>
#include <vector>

#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <glog/logging.h>

namespace dgsfm {

namespace {

// Observations below which the images of a camera cannot carry its intrinsics.
constexpr size_t kMinNumObservationsPerCamera = 50;
// Observations below which threads cost more than they give.
constexpr size_t kMinNumObservationsForThreads = 10000;

// The arrays of a model, and back.
class ModelBundle {
 public:
  ModelBundle(const BundleAdjustmentOptions& options,
              const CameraMap& prior_cameras,
              colmap::Reconstruction* model)
      : options_(options),
        prior_cameras_(prior_cameras),
        model_(model),
        point_ids_(SortedPoints(*model)) {
    for (size_t i = 0; i < point_ids_.size(); ++i) {
      point_indices_[point_ids_[i]] = int(i);
      bundle_.points.push_back(model->Point3D(point_ids_[i]).XYZ());
    }
    for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
      AddImage(image_id);
    }
    for (size_t i = 0; i < camera_ids_.size(); ++i) {
      RefineCamera(num_observations_[i], i);
    }
  }

  // Holds the pose of an image and one coordinate of another.
  void FixGauge(colmap::image_t fixed_image) {
    const Eigen::Vector3d center =
        CamFromWorld(model_->Image(fixed_image)).TargetOriginInSource();
    BundleImage* farthest = nullptr;
    double max_distance = 0;
    for (size_t i = 0; i < image_ids_.size(); ++i) {
      BundleImage& image = bundle_.images[i];
      if (image_ids_[i] == fixed_image) image.is_constant.fill(true);
      const double distance =
          (image.cam_from_world.TargetOriginInSource() - center).norm();
      if (distance > max_distance) {
        max_distance = distance;
        farthest = &image;
      }
    }
    if (!farthest) return;
    int coordinate = 0;
    farthest->cam_from_world.translation.cwiseAbs().maxCoeff(&coordinate);
    farthest->is_constant[3 + coordinate] = true;
  }

  std::optional<double> Solve(int num_threads) {
    const size_t num_observations = bundle_.observations.size();
    if (num_observations == 0) return std::nullopt;
    PointMinimizerOptions options;
    options.max_num_iterations = options_.max_num_iterations;
    options.function_tolerance = options_.function_tolerance;
    options.num_threads = num_observations < kMinNumObservationsForThreads
                              ? 1
                              : EffectiveNumThreads(num_threads);
    const PointMinimizerSummary summary =
        SolveBundle(options, options_.loss_scale_px, &camera_terms_, &bundle_);
    if (!summary.success) return std::nullopt;
    VLOG(1) << "Bundle adjustment: " << summary.num_iterations
            << " iterations, cost " << summary.initial_cost << " to "
            << summary.final_cost;
    WriteBack();
    return std::sqrt(2 * summary.final_cost / double(num_observations));
  }

 private:
  void AddImage(colmap::image_t image_id) {
    const colmap::Image& image = model_->Image(image_id);
    if (image.NumPoints3D() == 0) return;
    const colmap::Camera& camera = model_->Camera(image.CameraId());
    const auto [it, is_new] =
        camera_indices_.emplace(image.CameraId(), int(bundle_.cameras.size()));
    if (is_new) {
      camera_ids_.push_back(image.CameraId());
      num_observations_.push_back(0);
      bundle_.cameras.push_back({camera.ModelId(), camera.Params(), {}});
    }
    num_observations_[it->second] += image.NumPoints3D();
    for (const colmap::Point2D& point2D : image.Points2D()) {
      if (!point2D.HasPoint3D()) continue;
      bundle_.observations.push_back({int(image_ids_.size()),
                                      point_indices_.at(point2D.Point3DId()),
                                      point2D.XY()});
    }
    image_ids_.push_back(image_id);
    bundle_.images.push_back({CamFromWorld(image), it->second, {}});
  }

  void RefineCamera(size_t num_observations, size_t index) {
    const colmap::Camera& camera = model_->Camera(camera_ids_[index]);
    if (num_observations < kMinNumObservationsPerCamera) return;
    std::vector<int>& refined = bundle_.cameras[index].refined_params;
    const auto refine = [&](const std::vector<size_t>& idxs) {
      refined.insert(refined.end(), idxs.begin(), idxs.end());
    };
    if (options_.refine_focal_length) refine(camera.FocalLengthIdxs());
    if (options_.refine_principal_point && !camera.HasPriorFocalLength()) {
      refine(camera.PrincipalPointIdxs());
      AddPrior(camera.PrincipalPointIdxs(),
               options_.principal_point_stddev_ratio *
                   double(std::max(camera.Width(), camera.Height())),
               index);
    }
    if (options_.refine_extra_params) {
      refine(camera.ExtraParamsIdxs());
      AddPrior(camera.ExtraParamsIdxs(), options_.extra_params_stddev, index);
    }
  }

  // Normal prior about the database's values, in the unit of the image errors.
  void AddPrior(const std::vector<size_t>& idxs, double stddev, size_t index) {
    if (idxs.empty()) return;
    std::vector<double>& params = bundle_.cameras[index].params;
    ceres::Matrix A = ceres::Matrix::Zero(idxs.size(), params.size());
    for (size_t i = 0; i < idxs.size(); ++i) {
      A(i, idxs[i]) = options_.keypoint_stddev_px / stddev;
    }
    const ceres::Vector mean = Eigen::Map<const Eigen::VectorXd>(
        prior_cameras_.at(camera_ids_[index]).ParamsData(), params.size());
    camera_terms_.AddResidualBlock(
        new ceres::NormalPrior(A, mean), nullptr, params.data());
  }

  void WriteBack() {
    for (size_t i = 0; i < image_ids_.size(); ++i) {
      SetCamFromWorld(bundle_.images[i].cam_from_world,
                      &model_->Image(image_ids_[i]));
    }
    for (size_t i = 0; i < camera_ids_.size(); ++i) {
      model_->Camera(camera_ids_[i]).SetParams(bundle_.cameras[i].params);
    }
    for (size_t i = 0; i < point_ids_.size(); ++i) {
      model_->Point3D(point_ids_[i]).SetXYZ(bundle_.points[i]);
    }
  }

  const BundleAdjustmentOptions& options_;
  const CameraMap& prior_cameras_;
  colmap::Reconstruction* model_;
  // By their index in the bundle.
  std::vector<colmap::image_t> image_ids_;
  std::vector<colmap::camera_t> camera_ids_;
  const std::vector<colmap::point3D_t> point_ids_;
  std::map<colmap::camera_t, int> camera_indices_;
  std::unordered_map<colmap::point3D_t, int> point_indices_;
  std::vector<size_t> num_observations_;
  Bundle bundle_;
  // Terms of the `params` of the cameras of the bundle.
  ceres::Problem camera_terms_;
};

}  // namespace

bool BundleAdjustmentOptions::IsValid(std::string* error) const {
  return CheckOption(max_num_iterations >= 1,
                     "max_num_iterations must be >= 1",
                     max_num_iterations,
                     error) &&
         CheckOption(function_tolerance >= 0,
                     "function_tolerance must be >= 0",
                     function_tolerance,
                     error) &&
         CheckOption(loss_scale_px > 0,
                     "loss_scale_px must be > 0",
                     loss_scale_px,
                     error) &&
         CheckOption(principal_point_stddev_ratio > 0,
                     "principal_point_stddev_ratio must be > 0",
                     principal_point_stddev_ratio,
                     error) &&
         CheckOption(extra_params_stddev > 0,
                     "extra_params_stddev must be > 0",
                     extra_params_stddev,
                     error) &&
         CheckOption(keypoint_stddev_px > 0,
                     "keypoint_stddev_px must be > 0",
                     keypoint_stddev_px,
                     error);
}

std::optional<double> AdjustBundle(const BundleAdjustmentOptions& options,
                                   int num_threads,
                                   colmap::image_t fixed_image,
                                   const CameraMap& prior_cameras,
                                   colmap::Reconstruction* model) {
  if (model->NumPoints3D() == 0) return std::nullopt;
  ModelBundle bundle(options, prior_cameras, model);
  bundle.FixGauge(fixed_image);
  return bundle.Solve(num_threads);
}

}  // namespace dgsfm
