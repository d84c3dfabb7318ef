#include "estimators/optimization/bundle_solver.h"

#include "colmap_ext/check.h"
#include "estimators/optimization/camera_projection.h"
#include "estimators/rotation_vector.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace dgsfm {

namespace {

constexpr int kPose = 6;

// Moves a pose (R, t) to (exp(w) R, exp(w) (t - p) + p + d) by the step of the
// columns that have one, w and d.
template <typename Columns>
void MovePose(const Columns& columns,
              const Eigen::VectorXd& column_steps,
              const Eigen::Vector3d& pivot,
              Rigid3d* pose) {
  Eigen::Matrix<double, kPose, 1> step;
  for (int i = 0; i < kPose; ++i) {
    step(i) = columns[i] < 0 ? 0 : column_steps(columns[i]);
  }
  const Eigen::Quaterniond turn = RotationFromVector(step.head<3>());
  pose->rotation = (turn * pose->rotation).normalized();
  pose->translation =
      turn * (pose->translation - pivot) + pivot + step.tail<3>();
}

// Mean of points, weighted by the inverse of their distance from the origin.
class Pivot {
 public:
  void Add(const Eigen::Vector3d& point) {
    const double distance = point.norm();
    if (!(distance > 0)) return;
    sum_ += point / distance;
    weight_ += 1 / distance;
  }

  Eigen::Vector3d Mean() const {
    const Eigen::Vector3d mean = sum_ / weight_;
    return mean.allFinite() ? mean : Eigen::Vector3d::Zero();
  }

 private:
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  double weight_ = 0;
};

// The pose of each image is followed by up to kNumShared parameters: those of
// its camera, and the pose of its sensor where that is refined.
template <int kNumShared>
class BundleProblem : public PointProblem<2, kPose + kNumShared> {
 public:
  using Base = PointProblem<2, kPose + kNumShared>;
  using Row = typename Base::Row;

  BundleProblem(const RobustLoss& loss, Bundle* bundle)
      : loss_(loss), bundle_(bundle) {
    SortObservations();
    AssignColumns();
    UpdatePoses();
    SetPivots();
  }

  double Cost(int k) const override {
    Eigen::Vector2d xy_px;
    if (!Project(k, &xy_px, nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    return loss_.Cost((xy_px - Observation(k).xy_px).squaredNorm());
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
    const double weight = loss_.RootWeight(residual.squaredNorm());
    row->residual = weight * residual;
    jacobian.point *= weight;
    row->by_camera.template bottomRows<kNumShared>().setZero();
    LinearizePoses(observation, jacobian, row);
    for (size_t i = 0; i < camera.refined_params.size(); ++i) {
      row->by_camera.row(kPose + i) =
          weight * jacobian.params.col(camera.refined_params[i]).transpose();
    }
  }

  double TermsCost() const override {
    double cost = 0;
    for (const BundlePrior& prior : bundle_->priors) {
      const double squared_error = SquaredError(prior);
      const double squared_scale = prior.loss_scale_px * prior.loss_scale_px;
      cost +=
          0.5 * (std::isfinite(squared_scale)
                     ? squared_scale * std::log1p(squared_error / squared_scale)
                     : squared_error);
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
    for (const BundlePrior& prior : bundle_->priors) {
      const double weight =
          1 / (1 + SquaredError(prior) /
                       (prior.loss_scale_px * prior.loss_scale_px));
      for (const BundlePrior::Parameter& parameter : prior.parameters) {
        const int column = param_columns_[prior.camera][parameter.index];
        if (column < 0) continue;
        const double slope =
            weight / (parameter.stddev_per_px * parameter.stddev_per_px);
        (*gradient)(column) += slope * Deviation(prior, parameter);
        hessian->emplace_back(column, column, slope);
      }
    }
    for (size_t i = 0; i < bundle_->center_priors.size(); ++i) {
      LinearizeCenter(i, hessian, gradient);
    }
  }

  void Step(const Eigen::VectorXd& column_steps,
            const std::vector<Eigen::Vector3d>& point_steps) override {
    saved_ = {bundle_->images,
              bundle_->frames,
              bundle_->sensors,
              bundle_->cameras,
              bundle_->points};
    for (size_t i = 0; i < bundle_->images.size(); ++i) {
      BundleImage& image = bundle_->images[i];
      if (image.frame >= 0) continue;
      MovePose(this->camera_columns[i],
               column_steps,
               ImagePivot(i),
               &image.cam_from_world);
    }
    for (size_t i = 0; i < frame_columns_.size(); ++i) {
      MovePose(frame_columns_[i],
               column_steps,
               FramePivot(i),
               &bundle_->frames[i].rig_from_world);
    }
    for (size_t i = 0; i < sensor_columns_.size(); ++i) {
      MovePose(sensor_columns_[i],
               column_steps,
               bundle_->sensors[i].cam_from_rig.translation,
               &bundle_->sensors[i].cam_from_rig);
    }
    for (size_t i = 0; i < bundle_->cameras.size(); ++i) {
      for (const int param : bundle_->cameras[i].refined_params) {
        bundle_->cameras[i].params[param] +=
            column_steps(param_columns_[i][param]);
      }
    }
    for (size_t i = 0; i < bundle_->points.size(); ++i) {
      bundle_->points[i] += point_steps[i];
    }
    UpdatePoses();
  }

  void Undo() override {
    bundle_->images.swap(saved_.images);
    bundle_->frames.swap(saved_.frames);
    bundle_->sensors.swap(saved_.sensors);
    bundle_->cameras.swap(saved_.cameras);
    bundle_->points.swap(saved_.points);
    UpdatePoses();
  }

  Eigen::Vector3d& Point(int point) override { return bundle_->points[point]; }

 private:
  using PoseColumns = std::array<int, kPose>;

  struct Parameters {
    std::vector<BundleImage> images;
    std::vector<BundleFrame> frames;
    std::vector<BundleSensor> sensors;
    std::vector<BundleCamera> cameras;
    std::vector<Eigen::Vector3d> points;
  };

  const BundleObservation& Observation(int k) const {
    return bundle_->observations[k];
  }

  // Derivatives by the poses and the point, by the chain rule from those by the
  // point in the camera's frame.
  void LinearizePoses(const BundleObservation& observation,
                      const ProjectionJacobian& jacobian,
                      Row* row) const {
    const BundleImage& image = bundle_->images[observation.image];
    const Eigen::Matrix3d& rotation = rotations_[observation.image];
    const Eigen::Vector3d rotated =
        rotation * bundle_->points[observation.point];
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector3d by_point = jacobian.point.row(i);
      row->by_point.col(i).noalias() = rotation.transpose() * by_point;
      if (image.frame >= 0) {
        LinearizeFrame(image, rotated, by_point, i, row);
        continue;
      }
      row->by_camera.template block<3, 1>(0, i) =
          (rotated +
           (image.cam_from_world.translation - ImagePivot(observation.image)))
              .cross(by_point);
      row->by_camera.template block<3, 1>(3, i) = by_point;
    }
  }

  void LinearizeFrame(const BundleImage& image,
                      const Eigen::Vector3d& rotated,
                      const Eigen::Vector3d& by_point,
                      int residual,
                      Row* row) const {
    const BundleSensor& sensor = bundle_->sensors[image.sensor];
    const Eigen::Quaterniond rig_from_cam =
        sensor.cam_from_rig.rotation.conjugate();
    const Eigen::Vector3d by_point_in_rig = rig_from_cam * by_point;
    const Eigen::Vector3d offset =
        bundle_->frames[image.frame].rig_from_world.translation -
        FramePivot(image.frame);
    row->by_camera.template block<3, 1>(0, residual) =
        (rig_from_cam * rotated + offset).cross(by_point_in_rig);
    row->by_camera.template block<3, 1>(3, residual) = by_point_in_rig;
    if (!sensor.is_refined) return;
    const Eigen::Vector3d rotated_by_sensor = rotated +
                                              image.cam_from_world.translation -
                                              sensor.cam_from_rig.translation;
    const Eigen::Index first =
        kPose +
        Eigen::Index(bundle_->cameras[image.camera].refined_params.size());
    row->by_camera.template block<3, 1>(first, residual) =
        rotated_by_sensor.cross(by_point);
    row->by_camera.template block<3, 1>(first + 3, residual) = by_point;
  }

  void LinearizeCenter(size_t index,
                       typename Base::Triplets* hessian,
                       Eigen::VectorXd* gradient) const {
    const BundleImage& image = bundle_->images[index];
    std::array<int, 2 * kPose> columns;
    std::copy_n(this->camera_columns[index].begin(), kPose, columns.begin());
    Eigen::Matrix3Xd by_columns =
        CenterByPose(image.cam_from_world, ImagePivot(index));
    if (image.frame >= 0) {
      const PoseColumns& sensor_columns = sensor_columns_[image.sensor];
      std::copy(sensor_columns.begin(),
                sensor_columns.end(),
                columns.begin() + kPose);
      by_columns = CenterByPoses(bundle_->sensors[image.sensor].cam_from_rig,
                                 bundle_->frames[image.frame].rig_from_world,
                                 FramePivot(image.frame));
    }
    LinearizeCenterPrior(bundle_->center_priors[index],
                         bundle_->center_prior_weight,
                         image.cam_from_world.TargetOriginInSource(),
                         by_columns,
                         columns.data(),
                         hessian,
                         gradient);
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
    const auto is_before = [](const auto& a, const auto& b) {
      return std::tie(a.point, a.image) < std::tie(b.point, b.image);
    };
    if (!std::is_sorted(observations.begin(), observations.end(), is_before)) {
      std::stable_sort(observations.begin(), observations.end(), is_before);
    }
    this->observation_index.cameras.reserve(observations.size());
    this->observation_index.points.reserve(observations.size());
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
    for (const BundleCamera& camera : bundle_->cameras) {
      projections_.push_back(ProjectionOfModel(camera.model_id));
      auto& columns = param_columns_.emplace_back(camera.params.size(), -1);
      for (const int i : camera.refined_params) {
        columns.at(i) = this->num_columns++;
      }
    }
    for (const BundleFrame& frame : bundle_->frames) {
      frame_columns_.push_back(NewPoseColumns(frame.is_constant));
    }
    for (const BundleSensor& sensor : bundle_->sensors) {
      std::array<bool, kPose> is_constant;
      is_constant.fill(!sensor.is_refined);
      sensor_columns_.push_back(NewPoseColumns(is_constant));
    }
    for (const BundleImage& image : bundle_->images) AssignColumnsOf(image);
  }

  PoseColumns NewPoseColumns(const std::array<bool, kPose>& is_constant) {
    PoseColumns columns;
    for (int i = 0; i < kPose; ++i) {
      columns[i] = is_constant[i] ? -1 : this->num_columns++;
    }
    return columns;
  }

  void AssignColumnsOf(const BundleImage& image) {
    const BundleCamera& camera = bundle_->cameras.at(image.camera);
    const PoseColumns pose_columns = image.frame < 0
                                         ? NewPoseColumns(image.is_constant)
                                         : frame_columns_.at(image.frame);
    auto& columns = this->camera_columns.emplace_back();
    columns.fill(-1);
    auto next =
        std::copy(pose_columns.begin(), pose_columns.end(), columns.begin());
    for (const int param : camera.refined_params) {
      *next++ = param_columns_[image.camera][param];
    }
    if (image.frame >= 0 && bundle_->sensors.at(image.sensor).is_refined) {
      const PoseColumns& sensor_columns = sensor_columns_[image.sensor];
      std::copy(sensor_columns.begin(), sensor_columns.end(), next);
    }
  }

  double Deviation(const BundlePrior& prior,
                   const BundlePrior::Parameter& parameter) const {
    return bundle_->cameras[prior.camera].params[parameter.index] -
           parameter.mean;
  }

  double SquaredError(const BundlePrior& prior) const {
    double sum = 0;
    for (const BundlePrior::Parameter& parameter : prior.parameters) {
      sum += std::pow(Deviation(prior, parameter) / parameter.stddev_per_px, 2);
    }
    return sum;
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

  // What a pose turns about. Where a part of the translation is constant, and
  // by default, this is the translation, which a turn then leaves as it is.
  Eigen::Vector3d ImagePivot(size_t i) const {
    const BundleImage& image = bundle_->images[i];
    return TurnsAboutPoints(image.is_constant)
               ? image_pivots_[i]
               : image.cam_from_world.translation;
  }

  Eigen::Vector3d FramePivot(size_t i) const {
    const BundleFrame& frame = bundle_->frames[i];
    return TurnsAboutPoints(frame.is_constant)
               ? frame_pivots_[i]
               : frame.rig_from_world.translation;
  }

  bool TurnsAboutPoints(const std::array<bool, kPose>& is_constant) const {
    return bundle_->turn_about_points &&
           std::none_of(is_constant.begin() + 3,
                        is_constant.end(),
                        [](bool constant) { return constant; });
  }

  void SetPivots() {
    if (!bundle_->turn_about_points) return;
    std::vector<Pivot> images(bundle_->images.size());
    std::vector<Pivot> frames(bundle_->frames.size());
    for (const BundleObservation& observation : bundle_->observations) {
      const BundleImage& image = bundle_->images[observation.image];
      const Eigen::Vector3d& point = bundle_->points[observation.point];
      images[observation.image].Add(image.cam_from_world * point);
      if (image.frame < 0) continue;
      frames[image.frame].Add(bundle_->frames[image.frame].rig_from_world *
                              point);
    }
    for (const Pivot& pivot : images) image_pivots_.push_back(pivot.Mean());
    for (const Pivot& pivot : frames) frame_pivots_.push_back(pivot.Mean());
  }

  const RobustLoss loss_;
  Bundle* bundle_;
  std::vector<ProjectionFunction> projections_;
  // Column of each parameter of each camera, -1 where it is held.
  std::vector<std::vector<int>> param_columns_;
  std::vector<PoseColumns> frame_columns_;
  std::vector<PoseColumns> sensor_columns_;
  std::vector<Eigen::Matrix3d> rotations_;
  std::vector<Eigen::Vector3d> image_pivots_;
  std::vector<Eigen::Vector3d> frame_pivots_;
  // Before the last step.
  Parameters saved_;
};

}  // namespace

PointMinimizerSummary SolveBundle(const PointMinimizerOptions& options,
                                  const RobustLoss& loss,
                                  Bundle* bundle) {
  size_t num_intrinsics = 0;
  for (const BundleCamera& camera : bundle->cameras) {
    num_intrinsics = std::max(num_intrinsics, camera.refined_params.size());
  }
  const auto solve = [&](auto problem) {
    return MinimizeWithPoints(options, &problem);
  };
  if (std::any_of(bundle->sensors.begin(),
                  bundle->sensors.end(),
                  [](const auto& s) { return s.is_refined; })) {
    return solve(BundleProblem<kMaxNumCameraParams + kPose>(loss, bundle));
  }
  if (num_intrinsics <= 2) {
    return solve(BundleProblem<2>(loss, bundle));
  }
  if (num_intrinsics <= 4) {
    return solve(BundleProblem<4>(loss, bundle));
  }
  if (num_intrinsics <= 8) {
    return solve(BundleProblem<8>(loss, bundle));
  }
  return solve(BundleProblem<kMaxNumCameraParams>(loss, bundle));
}

}  // namespace dgsfm
