#include "estimators/optimization/bundle_solver.h"

#include "colmap_ext/check.h"
#include "estimators/optimization/bundle_bodies.h"
#include "estimators/optimization/camera_projection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

namespace dgsfm {

namespace {

constexpr int kPose = 6;

// The step of the columns of a pose that have one, rotation vector w first.
template <typename Columns>
PoseStep StepOf(const Columns& columns, const Eigen::VectorXd& column_steps) {
  PoseStep step;
  for (int i = 0; i < kPose; ++i) {
    step(i) = columns[i] < 0 ? 0 : column_steps(columns[i]);
  }
  return step;
}

// The pose of each image is followed by up to kNumShared parameters: those of
// its camera, and the pose of its sensor where that is refined.
template <int kNumShared>
class BundleProblem : public PointProblem<2, kPose + kNumShared> {
 public:
  using Base = PointProblem<2, kPose + kNumShared>;
  using Row = typename Base::Row;

  BundleProblem(const RobustLoss& loss, int num_threads, Bundle* bundle)
      : loss_(loss), num_threads_(num_threads), bundle_(bundle) {
    SortObservations();
    AssignColumns();
    UpdatePoses();
    bodies_.emplace(this->observation_index, bundle);
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
    std::vector<PoseStep> steps;
    for (const PoseColumns& columns : body_columns_) {
      steps.push_back(StepOf(columns, column_steps));
    }
    bodies_->Move(steps, point_steps, num_threads_);
    for (size_t i = 0; i < sensor_columns_.size(); ++i) {
      MovePose(StepOf(sensor_columns_[i], column_steps),
               bundle_->sensors[i].cam_from_rig.translation,
               &bundle_->sensors[i].cam_from_rig);
    }
    for (size_t i = 0; i < bundle_->cameras.size(); ++i) {
      for (const int param : bundle_->cameras[i].refined_params) {
        bundle_->cameras[i].params[param] +=
            column_steps(param_columns_[i][param]);
      }
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
    const Eigen::Vector3d point_in_cam =
        rotation * bundle_->points[observation.point] +
        image.cam_from_world.translation;
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector3d by_point = jacobian.point.row(i);
      row->by_point.col(i).noalias() = rotation.transpose() * by_point;
      if (image.frame >= 0) {
        LinearizeFrame(image, point_in_cam, by_point, i, row);
        continue;
      }
      row->by_camera.template block<3, 1>(0, i) =
          (point_in_cam - BodyPivot(*bundle_, image.cam_from_world))
              .cross(by_point);
      row->by_camera.template block<3, 1>(3, i) = by_point;
    }
  }

  void LinearizeFrame(const BundleImage& image,
                      const Eigen::Vector3d& point_in_cam,
                      const Eigen::Vector3d& by_point,
                      int residual,
                      Row* row) const {
    const BundleSensor& sensor = bundle_->sensors[image.sensor];
    const Eigen::Quaterniond rig_from_cam =
        sensor.cam_from_rig.rotation.conjugate();
    const Eigen::Vector3d by_point_in_rig = rig_from_cam * by_point;
    const Eigen::Vector3d point_in_rig =
        rig_from_cam * (point_in_cam - sensor.cam_from_rig.translation);
    const Eigen::Vector3d pivot =
        BodyPivot(*bundle_, bundle_->frames[image.frame].rig_from_world);
    row->by_camera.template block<3, 1>(0, residual) =
        (point_in_rig - pivot).cross(by_point_in_rig);
    row->by_camera.template block<3, 1>(3, residual) = by_point_in_rig;
    if (!sensor.is_refined) return;
    const Eigen::Index first =
        kPose +
        Eigen::Index(bundle_->cameras[image.camera].refined_params.size());
    row->by_camera.template block<3, 1>(first, residual) =
        (point_in_cam - sensor.cam_from_rig.translation).cross(by_point);
    row->by_camera.template block<3, 1>(first + 3, residual) = by_point;
  }

  void LinearizeCenter(size_t index,
                       typename Base::Triplets* hessian,
                       Eigen::VectorXd* gradient) const {
    const BundleImage& image = bundle_->images[index];
    std::array<int, 2 * kPose> columns;
    std::copy_n(this->camera_columns[index].begin(), kPose, columns.begin());
    Eigen::Matrix3Xd by_columns = CenterByPose(
        image.cam_from_world, BodyPivot(*bundle_, image.cam_from_world));
    if (image.frame >= 0) {
      const PoseColumns& sensor_columns = sensor_columns_[image.sensor];
      std::copy(sensor_columns.begin(),
                sensor_columns.end(),
                columns.begin() + kPose);
      const Rigid3d& rig_from_world =
          bundle_->frames[image.frame].rig_from_world;
      by_columns = CenterByPoses(bundle_->sensors[image.sensor].cam_from_rig,
                                 rig_from_world,
                                 BodyPivot(*bundle_, rig_from_world));
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
      body_columns_.push_back(NewPoseColumns(frame.is_constant));
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
    if (image.frame < 0) {
      body_columns_.push_back(NewPoseColumns(image.is_constant));
    }
    const PoseColumns& pose_columns =
        image.frame < 0 ? body_columns_.back() : body_columns_.at(image.frame);
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

  const RobustLoss loss_;
  const int num_threads_;
  Bundle* bundle_;
  std::vector<ProjectionFunction> projections_;
  // Column of each parameter of each camera, -1 where it is held.
  std::vector<std::vector<int>> param_columns_;
  std::vector<PoseColumns> body_columns_;
  std::vector<PoseColumns> sensor_columns_;
  std::vector<Eigen::Matrix3d> rotations_;
  // After the observations are sorted.
  std::optional<BundleBodies> bodies_;
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
    return solve(BundleProblem<kMaxNumCameraParams + kPose>(
        loss, options.num_threads, bundle));
  }
  if (num_intrinsics <= 2) {
    return solve(BundleProblem<2>(loss, options.num_threads, bundle));
  }
  if (num_intrinsics <= 4) {
    return solve(BundleProblem<4>(loss, options.num_threads, bundle));
  }
  if (num_intrinsics <= 8) {
    return solve(BundleProblem<8>(loss, options.num_threads, bundle));
  }
  return solve(
      BundleProblem<kMaxNumCameraParams>(loss, options.num_threads, bundle));
}

}  // namespace dgsfm
