#include "estimators/optimization/bundle_solver.h"

#include "colmap_ext/check.h"
#include "estimators/optimization/camera_projection.h"
#include "estimators/rotation_vector.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>

#include <ceres/crs_matrix.h>

namespace dgsfm {

namespace {

constexpr int kPose = 6;
// Scale of the Cauchy loss of log depths [standard deviations].
constexpr double kDepthLossScale = 2;

// The parameters of a camera or of further terms, with their columns.
struct ParameterBlock {
  double* values = nullptr;
  std::vector<int> columns;
  bool in_terms = false;
};

// With kUseDepth a third residual, that of the prior depth, and a further
// parameter of each image, its log scale, the first after the pose.
template <int kNumIntrinsics, bool kUseDepth>
class BundleProblem
    : public PointProblem<2 + kUseDepth, kPose + kUseDepth + kNumIntrinsics> {
 public:
  using Base = PointProblem<2 + kUseDepth, kPose + kUseDepth + kNumIntrinsics>;
  using Row = typename Base::Row;

  BundleProblem(double loss_scale_px,
                ceres::Problem* camera_terms,
                Bundle* bundle)
      : squared_loss_scale_(loss_scale_px * loss_scale_px),
        terms_(camera_terms),
        bundle_(bundle) {
    SortObservations();
    AssignColumns();
    UpdateRotations();
  }

  double Cost(int k) const override {
    Eigen::Vector2d xy_px;
    if (!Project(k, &xy_px, nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    const double squared_error = (xy_px - Observation(k).xy_px).squaredNorm();
    const double cost =
        squared_loss_scale_ *
        (std::sqrt(1 + squared_error / squared_loss_scale_) - 1);
    return kUseDepth ? cost + DepthCost(k) : cost;
  }

  void Linearize(int k, Row* row) const override {
    const BundleObservation& observation = Observation(k);
    const int image_index = observation.image;
    const BundleCamera& camera =
        bundle_->cameras[bundle_->images[image_index].camera];
    Eigen::Vector2d xy_px;
    ProjectionJacobian jacobian;
    Project(k, &xy_px, &jacobian);
    Eigen::Vector2d residual = xy_px - observation.xy_px;
    // Ceres's correction for losses of negative curvature.
    const double weight =
        1 /
        std::sqrt(std::sqrt(1 + residual.squaredNorm() / squared_loss_scale_));
    row->residual.template head<2>() = weight * residual;
    jacobian.point *= weight;
    const Eigen::Matrix3d& rotation = rotations_[image_index];
    const Eigen::Vector3d rotated =
        rotation * bundle_->points[observation.point];
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector3d by_point = jacobian.point.row(i);
      row->by_camera.template block<3, 1>(0, i) = rotated.cross(by_point);
      row->by_camera.template block<3, 1>(3, i) = by_point;
      row->by_point.col(i).noalias() = rotation.transpose() * by_point;
    }
    row->by_camera.template bottomRows<kUseDepth + kNumIntrinsics>().setZero();
    for (size_t i = 0; i < camera.refined_params.size(); ++i) {
      row->by_camera.row(kFirstIntrinsic + i).template head<2>() =
          weight * jacobian.params.col(camera.refined_params[i]).transpose();
    }
    if constexpr (kUseDepth) LinearizeDepth(k, rotated, row);
  }

  double TermsCost() const override {
    double cost = 0;
    if (terms_ != nullptr &&
        !terms_->Evaluate({}, &cost, nullptr, nullptr, nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    for (size_t i = 0; i < bundle_->center_priors.size(); ++i) {
      cost += CenterPriorCost(bundle_->center_priors[i],
                              bundle_->center_prior_weight,
                              bundle_->images[i].cam_from_world);
    }
    return cost;
  }

  void LinearizeTerms(typename Base::Triplets* hessian,
                      Eigen::VectorXd* gradient) const override {
    for (size_t i = 0; i < bundle_->center_priors.size(); ++i) {
      LinearizeCenterPrior(bundle_->center_priors[i],
                           bundle_->center_prior_weight,
                           bundle_->images[i].cam_from_world,
                           this->camera_columns[i].data(),
                           hessian,
                           gradient);
    }
    if (terms_ == nullptr) return;
    ceres::Problem::EvaluateOptions options;
    std::vector<int> columns;
    for (const ParameterBlock& block : parameters_) {
      if (!block.in_terms) continue;
      options.parameter_blocks.push_back(block.values);
      columns.insert(columns.end(), block.columns.begin(), block.columns.end());
    }
    std::vector<double> residuals;
    ceres::CRSMatrix jacobian;
    terms_->Evaluate(options, nullptr, &residuals, nullptr, &jacobian);
    for (int r = 0; r < jacobian.num_rows; ++r) {
      for (int i = jacobian.rows[r]; i < jacobian.rows[r + 1]; ++i) {
        const int column1 = columns[jacobian.cols[i]];
        if (column1 < 0) continue;
        (*gradient)(column1) += jacobian.values[i] * residuals[r];
        for (int j = jacobian.rows[r]; j < jacobian.rows[r + 1]; ++j) {
          const int column2 = columns[jacobian.cols[j]];
          if (column2 < 0 || column2 > column1) continue;
          hessian->emplace_back(
              column1, column2, jacobian.values[i] * jacobian.values[j]);
        }
      }
    }
  }

  void Step(const Eigen::VectorXd& column_steps,
            const std::vector<Eigen::Vector3d>& point_steps) override {
    Save();
    for (size_t i = 0; i < bundle_->images.size(); ++i) {
      Eigen::Matrix<double, kFirstIntrinsic, 1> step;
      for (int j = 0; j < kFirstIntrinsic; ++j) {
        const int column = this->camera_columns[i][j];
        step(j) = column < 0 ? 0 : column_steps(column);
      }
      if (kUseDepth) bundle_->images[i].log_depth_scale += step(kPose);
      Rigid3d& pose = bundle_->images[i].cam_from_world;
      pose.rotation =
          (RotationFromVector(step.template head<3>()) * pose.rotation)
              .normalized();
      pose.translation += step.template segment<3>(3);
    }
    for (ParameterBlock& block : parameters_) {
      for (size_t i = 0; i < block.columns.size(); ++i) {
        if (block.columns[i] >= 0) {
          block.values[i] += column_steps(block.columns[i]);
        }
      }
    }
    for (size_t i = 0; i < bundle_->points.size(); ++i) {
      bundle_->points[i] += point_steps[i];
    }
    UpdateRotations();
  }

  void Undo() override {
    for (size_t i = 0; i < bundle_->images.size(); ++i) {
      bundle_->images[i] = saved_images_[i];
    }
    size_t next = 0;
    for (ParameterBlock& block : parameters_) {
      for (size_t i = 0; i < block.columns.size(); ++i) {
        block.values[i] = saved_parameters_[next++];
      }
    }
    bundle_->points.swap(saved_points_);
    UpdateRotations();
  }

  Eigen::Vector3d& Point(int point) override { return bundle_->points[point]; }

 private:
  static constexpr int kFirstIntrinsic = kPose + kUseDepth;

  const BundleObservation& Observation(int k) const {
    return bundle_->observations[k];
  }

  bool HasDepth(int k) const {
    return Observation(k).prior_depth > 0 &&
           bundle_->images[Observation(k).image].depth_weight_px > 0;
  }

  // In standard deviations. The depth of a point behind the camera counts by
  // its absolute value: the reprojection error already penalises the point.
  double DepthError(int k, double z) const {
    const BundleImage& image = bundle_->images[Observation(k).image];
    return (std::log(std::abs(z) / Observation(k).prior_depth) -
            image.log_depth_scale) /
           image.depth_stddev;
  }

  double DepthCost(int k) const {
    if (!HasDepth(k)) return 0;
    const BundleObservation& observation = Observation(k);
    const BundleImage& image = bundle_->images[observation.image];
    const double z = rotations_[observation.image].row(2).dot(
                         bundle_->points[observation.point]) +
                     image.cam_from_world.translation.z();
    const double ratio = DepthError(k, z) / kDepthLossScale;
    return 0.5 * std::pow(image.depth_weight_px * kDepthLossScale, 2) *
           std::log1p(ratio * ratio);
  }

  void LinearizeDepth(int k, const Eigen::Vector3d& rotated, Row* row) const {
    row->residual(2) = 0;
    row->by_camera.col(2).setZero();
    row->by_point.col(2).setZero();
    if (!HasDepth(k)) return;
    const BundleObservation& observation = Observation(k);
    const BundleImage& image = bundle_->images[observation.image];
    const double z = rotated.z() + image.cam_from_world.translation.z();
    const double error = DepthError(k, z);
    const double weight = image.depth_weight_px /
                          std::sqrt(1 + std::pow(error / kDepthLossScale, 2));
    const double by_log = weight / image.depth_stddev;
    const Eigen::Vector3d by_point = Eigen::Vector3d::UnitZ() * (by_log / z);
    row->residual(2) = weight * error;
    row->by_camera.template block<3, 1>(0, 2) = rotated.cross(by_point);
    row->by_camera.template block<3, 1>(3, 2) = by_point;
    row->by_camera(kPose, 2) = -by_log;
    row->by_point.col(2).noalias() =
        rotations_[observation.image].transpose() * by_point;
  }

  bool Project(int k,
               Eigen::Vector2d* xy_px,
               ProjectionJacobian* jacobian) const {
    const BundleObservation& observation = Observation(k);
    const BundleImage& image = bundle_->images[observation.image];
    const Eigen::Vector3d point_in_cam =
        rotations_[observation.image] * bundle_->points[observation.point] +
        image.cam_from_world.translation;
    return projections_[image.camera](
        bundle_->cameras[image.camera].params.data(),
        point_in_cam,
        xy_px,
        jacobian);
  }

  void SortObservations() {
    const int num_images = int(bundle_->images.size());
    const int num_points = int(bundle_->points.size());
    auto& observations = bundle_->observations;
    std::stable_sort(observations.begin(),
                     observations.end(),
                     [](const auto& a, const auto& b) {
                       return std::tie(a.point, a.image) <
                              std::tie(b.point, b.image);
                     });
    this->observation_index.num_cameras = num_images;
    this->observation_index.num_points = num_points;
    for (const BundleObservation& observation : observations) {
      DGSFM_CHECK(observation.image >= 0 && observation.image < num_images &&
                  observation.point >= 0 && observation.point < num_points)
          << "observation of point " << observation.point << " by image "
          << observation.image;
      this->observation_index.cameras.push_back(observation.image);
      this->observation_index.points.push_back(observation.point);
    }
  }

  void AssignColumns() {
    for (BundleCamera& camera : bundle_->cameras) {
      projections_.push_back(ProjectionOfModel(camera.model_id));
      ParameterBlock block;
      block.values = camera.params.data();
      block.columns.assign(camera.params.size(), -1);
      block.in_terms =
          terms_ != nullptr && terms_->HasParameterBlock(block.values);
      for (const int i : camera.refined_params) {
        block.columns.at(i) = this->num_columns++;
      }
      parameters_.push_back(block);
    }
    for (const BundleImage& image : bundle_->images) {
      const BundleCamera& camera = bundle_->cameras.at(image.camera);
      auto& columns = this->camera_columns.emplace_back();
      columns.fill(-1);
      for (int i = 0; i < kPose; ++i) {
        if (!image.is_constant[i]) columns[i] = this->num_columns++;
      }
      if (kUseDepth && image.depth_weight_px > 0) {
        columns[kPose] = this->num_columns++;
      }
      for (size_t i = 0; i < camera.refined_params.size(); ++i) {
        columns[kFirstIntrinsic + i] =
            parameters_[image.camera].columns[camera.refined_params[i]];
      }
    }
    if (terms_ != nullptr) AddBlocksOfTerms();
  }

  void AddBlocksOfTerms() {
    std::vector<double*> blocks;
    terms_->GetParameterBlocks(&blocks);
    for (double* values : blocks) {
      if (std::any_of(
              parameters_.begin(), parameters_.end(), [&](const auto& block) {
                return block.values == values;
              })) {
        continue;
      }
      ParameterBlock block;
      block.values = values;
      block.in_terms = true;
      block.columns.resize(terms_->ParameterBlockSize(values));
      std::iota(block.columns.begin(), block.columns.end(), this->num_columns);
      this->num_columns += int(block.columns.size());
      parameters_.push_back(block);
    }
  }

  void UpdateRotations() {
    rotations_.clear();
    for (const BundleImage& image : bundle_->images) {
      rotations_.push_back(image.cam_from_world.rotation.toRotationMatrix());
    }
  }

  void Save() {
    saved_images_ = bundle_->images;
    saved_parameters_.clear();
    for (const ParameterBlock& block : parameters_) {
      saved_parameters_.insert(saved_parameters_.end(),
                               block.values,
                               block.values + block.columns.size());
    }
    saved_points_ = bundle_->points;
  }

  const double squared_loss_scale_;
  ceres::Problem* terms_;
  Bundle* bundle_;
  std::vector<ProjectionFunction> projections_;
  // Those of the cameras, in their order, then those of the terms alone.
  std::vector<ParameterBlock> parameters_;
  std::vector<Eigen::Matrix3d> rotations_;
  std::vector<BundleImage> saved_images_;
  std::vector<double> saved_parameters_;
  std::vector<Eigen::Vector3d> saved_points_;
};

}  // namespace

PointMinimizerSummary SolveBundle(const PointMinimizerOptions& options,
                                  double loss_scale_px,
                                  ceres::Problem* camera_terms,
                                  Bundle* bundle) {
  size_t num_intrinsics = 0;
  for (const BundleCamera& camera : bundle->cameras) {
    num_intrinsics = std::max(num_intrinsics, camera.refined_params.size());
  }
  const auto solve = [&](auto problem) {
    return MinimizeWithPoints(options, &problem);
  };
  const bool use_depth = std::any_of(
      bundle->images.begin(), bundle->images.end(), [](const auto& image) {
        return image.depth_weight_px > 0;
      });
  if (use_depth && num_intrinsics <= 4) {
    return solve(BundleProblem<4, true>(loss_scale_px, camera_terms, bundle));
  }
  if (use_depth) {
    return solve(BundleProblem<kMaxNumCameraParams, true>(
        loss_scale_px, camera_terms, bundle));
  }
  if (num_intrinsics <= 2) {
    return solve(BundleProblem<2, false>(loss_scale_px, camera_terms, bundle));
  }
  if (num_intrinsics <= 4) {
    return solve(BundleProblem<4, false>(loss_scale_px, camera_terms, bundle));
  }
  if (num_intrinsics <= 8) {
    return solve(BundleProblem<8, false>(loss_scale_px, camera_terms, bundle));
  }
  return solve(BundleProblem<kMaxNumCameraParams, false>(
      loss_scale_px, camera_terms, bundle));
}

}  // namespace dgsfm
