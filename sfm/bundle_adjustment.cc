#include "sfm/bundle_adjustment.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/option_check.h"
#include "sfm/model_access.h"

#include <colmap/base/camera_models.h>
#include <colmap/base/cost_functions.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <vector>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

namespace dgsfm {

namespace {

// Observations below which the images of a camera cannot carry its intrinsics.
constexpr size_t kMinNumObservationsPerCamera = 50;
// Images up to which the reduced camera matrix is kept dense, and sparse.
constexpr size_t kMaxNumImagesDense = 50;
constexpr size_t kMaxNumImagesSparse = 1000;
// Residuals below which threads cost more than they give.
constexpr int kMinNumResidualsForThreads = 20000;

ceres::CostFunction* CreateReprojectionCost(const colmap::Camera& camera,
                                            const Eigen::Vector2d& xy_px) {
  switch (camera.ModelId()) {
#define CAMERA_MODEL_CASE(CameraModel)                                        \
  case colmap::CameraModel::kModelId:                                         \
    return colmap::BundleAdjustmentCostFunction<colmap::CameraModel>::Create( \
        xy_px);

    CAMERA_MODEL_SWITCH_CASES

#undef CAMERA_MODEL_CASE
  }
  return nullptr;
}

class BundleProblem {
 public:
  BundleProblem(const BundleAdjustmentOptions& options,
                const CameraMap& prior_cameras,
                colmap::Reconstruction* model)
      : options_(options),
        prior_cameras_(prior_cameras),
        model_(model),
        loss_(options.loss_scale_px) {
    ceres::Problem::Options problem_options;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_ = std::make_unique<ceres::Problem>(problem_options);
    for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
      AddImage(image_id);
    }
    for (const auto& [camera_id, count] : num_observations_) {
      ParameterizeCamera(count, &model->Camera(camera_id));
    }
  }

  void FixGauge(colmap::image_t fixed_image) {
    colmap::Image& image = model_->Image(fixed_image);
    if (problem_->HasParameterBlock(image.Tvec().data())) {
      problem_->SetParameterBlockConstant(image.Qvec().data());
      problem_->SetParameterBlockConstant(image.Tvec().data());
    }
    const Eigen::Vector3d center = CamFromWorld(image).TargetOriginInSource();
    colmap::Image* farthest = nullptr;
    double max_distance = 0;
    for (const colmap::image_t image_id : SortedRegisteredImages(*model_)) {
      colmap::Image& other = model_->Image(image_id);
      const double distance =
          (CamFromWorld(other).TargetOriginInSource() - center).norm();
      if (distance > max_distance &&
          problem_->HasParameterBlock(other.Tvec().data())) {
        max_distance = distance;
        farthest = &other;
      }
    }
    if (!farthest) return;
    int coordinate = 0;
    farthest->Tvec().cwiseAbs().maxCoeff(&coordinate);
    colmap::SetSubsetManifold(
        3, {coordinate}, problem_.get(), farthest->Tvec().data());
  }

  std::optional<double> Solve(int num_threads) {
    if (problem_->NumResiduals() == 0) return std::nullopt;
    ceres::Solver::Options solver;
    solver.max_num_iterations = options_.max_num_iterations;
    solver.function_tolerance = 1e-6;
    solver.gradient_tolerance = 1e-10;
    solver.parameter_tolerance = 1e-8;
    solver.max_num_consecutive_invalid_steps = 10;
    solver.logging_type = ceres::LoggingType::SILENT;
    solver.num_threads = problem_->NumResiduals() < kMinNumResidualsForThreads
                             ? 1
                             : EffectiveNumThreads(num_threads);
    const size_t num_images = model_->NumRegImages();
    if (num_images <= kMaxNumImagesDense) {
      solver.linear_solver_type = ceres::DENSE_SCHUR;
    } else if (num_images <= kMaxNumImagesSparse) {
      solver.linear_solver_type = ceres::SPARSE_SCHUR;
    } else {
      solver.linear_solver_type = ceres::ITERATIVE_SCHUR;
      solver.preconditioner_type = ceres::SCHUR_JACOBI;
      solver.max_linear_solver_iterations = 200;
    }
    ceres::Solver::Summary summary;
    ceres::Solve(solver, problem_.get(), &summary);
    if (!summary.IsSolutionUsable() || !std::isfinite(summary.final_cost)) {
      return std::nullopt;
    }
    return std::sqrt(2 * summary.final_cost /
                     std::max<double>(1, 0.5 * summary.num_residuals));
  }

 private:
  void AddImage(colmap::image_t image_id) {
    colmap::Image& image = model_->Image(image_id);
    if (image.NumPoints3D() == 0) return;
    // The cost functions assume unit quaternions.
    image.NormalizeQvec();
    colmap::Camera& camera = model_->Camera(image.CameraId());
    for (const colmap::Point2D& point2D : image.Points2D()) {
      if (!point2D.HasPoint3D()) continue;
      problem_->AddResidualBlock(
          CreateReprojectionCost(camera, point2D.XY()),
          &loss_,
          image.Qvec().data(),
          image.Tvec().data(),
          model_->Point3D(point2D.Point3DId()).XYZ().data(),
          camera.ParamsData());
    }
    num_observations_[image.CameraId()] += image.NumPoints3D();
    colmap::SetQuaternionManifold(problem_.get(), image.Qvec().data());
  }

  void ParameterizeCamera(size_t num_observations, colmap::Camera* camera) {
    const bool refine_principal_point =
        options_.refine_principal_point && !camera->HasPriorFocalLength();
    std::vector<int> constant;
    const auto add_constant = [&](const std::vector<size_t>& idxs) {
      constant.insert(constant.end(), idxs.begin(), idxs.end());
    };
    if (!options_.refine_focal_length) add_constant(camera->FocalLengthIdxs());
    if (!options_.refine_extra_params) add_constant(camera->ExtraParamsIdxs());
    if (!refine_principal_point) add_constant(camera->PrincipalPointIdxs());
    if (num_observations < kMinNumObservationsPerCamera ||
        constant.size() == camera->NumParams()) {
      problem_->SetParameterBlockConstant(camera->ParamsData());
      return;
    }
    if (!constant.empty()) {
      colmap::SetSubsetManifold(int(camera->NumParams()),
                                constant,
                                problem_.get(),
                                camera->ParamsData());
    }
    if (refine_principal_point) {
      AddPrior(camera->PrincipalPointIdxs(),
               options_.principal_point_stddev_ratio *
                   double(std::max(camera->Width(), camera->Height())),
               camera);
    }
    if (options_.refine_extra_params) {
      AddPrior(camera->ExtraParamsIdxs(), options_.extra_params_stddev, camera);
    }
  }

  // Normal prior about the database's values, in the unit of the image errors.
  void AddPrior(const std::vector<size_t>& idxs,
                double stddev,
                colmap::Camera* camera) {
    if (idxs.empty()) return;
    ceres::Matrix A = ceres::Matrix::Zero(idxs.size(), camera->NumParams());
    for (size_t i = 0; i < idxs.size(); ++i) {
      A(i, idxs[i]) = options_.keypoint_stddev_px / stddev;
    }
    const ceres::Vector mean = Eigen::Map<const Eigen::VectorXd>(
        prior_cameras_.at(camera->CameraId()).ParamsData(),
        camera->NumParams());
    problem_->AddResidualBlock(
        new ceres::NormalPrior(A, mean), nullptr, camera->ParamsData());
  }

  const BundleAdjustmentOptions& options_;
  const CameraMap& prior_cameras_;
  colmap::Reconstruction* model_;
  ceres::SoftLOneLoss loss_;
  std::unique_ptr<ceres::Problem> problem_;
  std::map<colmap::camera_t, size_t> num_observations_;
};

}  // namespace

bool BundleAdjustmentOptions::IsValid(std::string* error) const {
  return CheckOption(max_num_iterations >= 1,
                     "max_num_iterations must be >= 1",
                     max_num_iterations,
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
  BundleProblem problem(options, prior_cameras, model);
  problem.FixGauge(fixed_image);
  return problem.Solve(num_threads);
}

}  // namespace dgsfm
