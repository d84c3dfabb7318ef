#include "estimators/optimization/bundle_solver.h"

#include "colmap_ext/check.h"
#include "estimators/optimization/camera_projection.h"

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

Eigen::Quaterniond RotationFromVector(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  if (angle == 0) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector / angle));
}

// The parameters of a camera or of further terms, with their columns.
struct ParameterBlock {
  double* values = nullptr;
  std::vector<int> columns;
  bool in_terms = false;
};

// Moves a pose by the step of the columns that have one.
template <typename Columns>
void MovePose(const Columns& columns,
              const Eigen::VectorXd& column_steps,
              Rigid3d* pose) {
  Eigen::Matrix<double, kPose, 1> step;
  for (int i = 0; i < kPose; ++i) {
    step(i) = columns[i] < 0 ? 0 : column_steps(columns[i]);
  }
  pose->rotation =
      (RotationFromVector(step.template head<3>()) * pose->rotation)
          .normalized();
  pose->translation += step.template tail<3>();
}

// With kUseDepth a third residual, that of the prior depth, and a further
// parameter of each image, its log scale, the first after the pose. Up to
// kNumShared parameters are those of its camera and of its sensor.
template <int kNumShared, bool kUseDepth>
class BundleProblem
    : public PointProblem<2 + kUseDepth, kPose + kUseDepth + kNumShared> {
 public:
  using Base = PointProblem<2 + kUseDepth, kPose + kUseDepth + kNumShared>;
  using Row = typename Base::Row;

  BundleProblem(double loss_scale_px,
                ceres::Problem* camera_terms,
                Bundle* bundle)
      : squared_loss_scale_(loss_scale_px * loss_scale_px),
        terms_(camera_terms),
        bundle_(bundle) {
    SortObservations();
    AssignColumns();
    UpdatePoses();
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
    const BundleCamera& camera =
        bundle_->cameras[bundle_->images[observation.image].camera];
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
    row->by_camera.template bottomRows<kUseDepth + kNumShared>().setZero();
    const Eigen::Vector3d rotated =
        rotations_[observation.image] * bundle_->points[observation.point];
    for (int i = 0; i < 2; ++i) {
      LinearizePose(k, rotated, jacobian.point.row(i), i, row);
    }
    for (size_t i = 0; i < camera.refined_params.size(); ++i) {
      row->by_camera.row(kFirstShared + i).template head<2>() =
          weight * jacobian.params.col(camera.refined_params[i]).transpose();
    }
    if constexpr (kUseDepth) LinearizeDepth(k, rotated, row);
  }

  double TermsCost() const override {
    if (terms_ == nullptr) return 0;
    double cost = 0;
    const bool success = terms_->Evaluate({}, &cost, nullptr, nullptr, nullptr);
    return success ? cost : std::numeric_limits<double>::infinity();
  }

  void LinearizeTerms(typename Base::Triplets* hessian,
                      Eigen::VectorXd* gradient) const override {
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
      BundleImage& image = bundle_->images[i];
      const auto& columns = this->camera_columns[i];
      if (kUseDepth && columns[kPose] >= 0) {
        image.log_depth_scale += column_steps(columns[kPose]);
      }
      if (image.frame < 0) {
        MovePose(columns, column_steps, &image.cam_from_world);
      }
    }
    for (size_t i = 0; i < frame_columns_.size(); ++i) {
      MovePose(
          frame_columns_[i], column_steps, &bundle_->frames[i].rig_from_world);
    }
    for (size_t i = 0; i < sensor_columns_.size(); ++i) {
      MovePose(
          sensor_columns_[i], column_steps, &bundle_->sensors[i].cam_from_rig);
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
    UpdatePoses();
  }

  void Undo() override {
    bundle_->images = saved_images_;
    bundle_->frames = saved_frames_;
    bundle_->sensors = saved_sensors_;
    size_t next = 0;
    for (ParameterBlock& block : parameters_) {
      for (size_t i = 0; i < block.columns.size(); ++i) {
        block.values[i] = saved_parameters_[next++];
      }
    }
    bundle_->points.swap(saved_points_);
    UpdatePoses();
  }

  Eigen::Vector3d& Point(int point) override { return bundle_->points[point]; }

 private:
  static constexpr int kFirstShared = kPose + kUseDepth;
  using PoseColumns = std::array<int, kPose>;

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

  // Derivatives of a residual by poses and point, given the point rotated into
  // the camera's frame and the derivative by the point in that frame.
  void LinearizePose(int k,
                     const Eigen::Vector3d& rotated,
                     const Eigen::Vector3d& by_point_in_cam,
                     int residual,
                     Row* row) const {
    const BundleObservation& observation = Observation(k);
    const BundleImage& image = bundle_->images[observation.image];
    row->by_point.col(residual).noalias() =
        rotations_[observation.image].transpose() * by_point_in_cam;
    if (image.frame < 0) {
      row->by_camera.template block<3, 1>(0, residual) =
          rotated.cross(by_point_in_cam);
      row->by_camera.template block<3, 1>(3, residual) = by_point_in_cam;
      return;
    }
    const BundleSensor& sensor = bundle_->sensors[image.sensor];
    const Eigen::Quaterniond rig_from_cam =
        sensor.cam_from_rig.rotation.conjugate();
    const Eigen::Vector3d by_point_in_rig = rig_from_cam * by_point_in_cam;
    row->by_camera.template block<3, 1>(0, residual) =
        (rig_from_cam * rotated).cross(by_point_in_rig);
    row->by_camera.template block<3, 1>(3, residual) = by_point_in_rig;
    if (!sensor.is_refined) return;
    const Eigen::Vector3d rotated_by_sensor = rotated +
                                              image.cam_from_world.translation -
                                              sensor.cam_from_rig.translation;
    const Eigen::Index first =
        kFirstShared +
        Eigen::Index(bundle_->cameras[image.camera].refined_params.size());
    row->by_camera.template block<3, 1>(first, residual) =
        rotated_by_sensor.cross(by_point_in_cam);
    row->by_camera.template block<3, 1>(first + 3, residual) = by_point_in_cam;
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
    LinearizePose(k, rotated, by_point, 2, row);
    row->by_camera(kPose, 2) = -by_log;
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
    for (const BundleFrame& frame : bundle_->frames) {
      frame_columns_.push_back(NewPoseColumns(frame.is_constant));
    }
    for (const BundleSensor& sensor : bundle_->sensors) {
      std::array<bool, kPose> is_constant;
      is_constant.fill(!sensor.is_refined);
      sensor_columns_.push_back(NewPoseColumns(is_constant));
    }
    for (const BundleImage& image : bundle_->images) {
      const BundleCamera& camera = bundle_->cameras.at(image.camera);
      const PoseColumns pose_columns = image.frame < 0
                                           ? NewPoseColumns(image.is_constant)
                                           : frame_columns_.at(image.frame);
      auto& columns = this->camera_columns.emplace_back();
      columns.fill(-1);
      std::copy(pose_columns.begin(), pose_columns.end(), columns.begin());
      if (kUseDepth && image.depth_weight_px > 0) {
        columns[kPose] = this->num_columns++;
      }
      for (size_t i = 0; i < camera.refined_params.size(); ++i) {
        columns[kFirstShared + i] =
            parameters_[image.camera].columns[camera.refined_params[i]];
      }
      if (image.frame >= 0 && bundle_->sensors.at(image.sensor).is_refined) {
        std::copy(sensor_columns_[image.sensor].begin(),
                  sensor_columns_[image.sensor].end(),
                  columns.begin() + kFirstShared +
                      std::ptrdiff_t(camera.refined_params.size()));
      }
    }
    if (terms_ != nullptr) AddBlocksOfTerms();
  }

  PoseColumns NewPoseColumns(const std::array<bool, kPose>& is_constant) {
    PoseColumns columns;
    for (int i = 0; i < kPose; ++i) {
      columns[i] = is_constant[i] ? -1 : this->num_columns++;
    }
    return columns;
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

  // Poses of images of frames, and rotation matrices of all.
  void UpdatePoses() {
    rotations_.clear();
    for (BundleImage& image : bundle_->images) {
      if (image.frame >= 0) {
        image.cam_from_world = bundle_->sensors[image.sensor].cam_from_rig *
                               bundle_->frames[image.frame].rig_from_world;
      }
      rotations_.push_back(image.cam_from_world.rotation.toRotationMatrix());
    }
  }

  void Save() {
    saved_images_ = bundle_->images;
    saved_frames_ = bundle_->frames;
    saved_sensors_ = bundle_->sensors;
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
  std::vector<PoseColumns> frame_columns_;
  std::vector<PoseColumns> sensor_columns_;
  std::vector<Eigen::Matrix3d> rotations_;
  std::vector<BundleImage> saved_images_;
  std::vector<BundleFrame> saved_frames_;
  std::vector<BundleSensor> saved_sensors_;
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
  const bool refines_sensors = std::any_of(
      bundle->sensors.begin(), bundle->sensors.end(), [](const auto& sensor) {
        return sensor.is_refined;
      });
  if (refines_sensors) {
    constexpr int kNumShared = kMaxNumCameraParams + kPose;
    if (use_depth) {
      return solve(
          BundleProblem<kNumShared, true>(loss_scale_px, camera_terms, bundle));
    }
    return solve(
        BundleProblem<kNumShared, false>(loss_scale_px, camera_terms, bundle));
  }
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
