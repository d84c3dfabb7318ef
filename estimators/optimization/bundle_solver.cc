#include "estimators/optimization/bundle_solver.h"

#include "colmap_ext/check.h"
#include "estimators/optimization/camera_projection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace dgsfm {

namespace {

constexpr int kPose = 6;

Eigen::Quaterniond RotationFromVector(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  if (angle == 0) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector / angle));
}

template <int kNumIntrinsics>
class BundleProblem : public PointProblem<2, kPose + kNumIntrinsics> {
 public:
  using Base = PointProblem<2, kPose + kNumIntrinsics>;
  using Row = typename Base::Row;

  BundleProblem(double loss_scale_px, Bundle* bundle)
      : squared_loss_scale_(loss_scale_px * loss_scale_px), bundle_(bundle) {
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
    return squared_loss_scale_ *
           (std::sqrt(1 + squared_error / squared_loss_scale_) - 1);
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
    row->residual = weight * residual;
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
    row->by_camera.template bottomRows<kNumIntrinsics>().setZero();
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
  }

  void Step(const Eigen::VectorXd& column_steps,
            const std::vector<Eigen::Vector3d>& point_steps) override {
    saved_images_ = bundle_->images;
    saved_cameras_ = bundle_->cameras;
    saved_points_ = bundle_->points;
    for (size_t i = 0; i < bundle_->images.size(); ++i) {
      Eigen::Matrix<double, kPose, 1> step;
      for (int j = 0; j < kPose; ++j) {
        const int column = this->camera_columns[i][j];
        step(j) = column < 0 ? 0 : column_steps(column);
      }
      Rigid3d& pose = bundle_->images[i].cam_from_world;
      pose.rotation =
          (RotationFromVector(step.template head<3>()) * pose.rotation)
              .normalized();
      pose.translation += step.template segment<3>(3);
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
    UpdateRotations();
  }

  void Undo() override {
    bundle_->images.swap(saved_images_);
    bundle_->cameras.swap(saved_cameras_);
    bundle_->points.swap(saved_points_);
    UpdateRotations();
  }

  Eigen::Vector3d& Point(int point) override { return bundle_->points[point]; }

 private:
  const BundleObservation& Observation(int k) const {
    return bundle_->observations[k];
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
    for (const BundleCamera& camera : bundle_->cameras) {
      projections_.push_back(ProjectionOfModel(camera.model_id));
      auto& columns = param_columns_.emplace_back(camera.params.size(), -1);
      for (const int i : camera.refined_params) {
        columns.at(i) = this->num_columns++;
      }
    }
    for (const BundleImage& image : bundle_->images) {
      const BundleCamera& camera = bundle_->cameras.at(image.camera);
      auto& columns = this->camera_columns.emplace_back();
      columns.fill(-1);
      for (int i = 0; i < kPose; ++i) {
        if (!image.is_constant[i]) columns[i] = this->num_columns++;
      }
      for (size_t i = 0; i < camera.refined_params.size(); ++i) {
        columns[kPose + i] =
            param_columns_[image.camera][camera.refined_params[i]];
      }
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

  void UpdateRotations() {
    rotations_.clear();
    for (const BundleImage& image : bundle_->images) {
      rotations_.push_back(image.cam_from_world.rotation.toRotationMatrix());
    }
  }

  const double squared_loss_scale_;
  Bundle* bundle_;
  std::vector<ProjectionFunction> projections_;
  // Column of each parameter of each camera, -1 where it is held.
  std::vector<std::vector<int>> param_columns_;
  std::vector<Eigen::Matrix3d> rotations_;
  std::vector<BundleImage> saved_images_;
  std::vector<BundleCamera> saved_cameras_;
  std::vector<Eigen::Vector3d> saved_points_;
};

}  // namespace

PointMinimizerSummary SolveBundle(const PointMinimizerOptions& options,
                                  double loss_scale_px,
                                  Bundle* bundle) {
  size_t num_intrinsics = 0;
  for (const BundleCamera& camera : bundle->cameras) {
    num_intrinsics = std::max(num_intrinsics, camera.refined_params.size());
  }
  const auto solve = [&](auto problem) {
    return MinimizeWithPoints(options, &problem);
  };
  if (num_intrinsics <= 2) {
    return solve(BundleProblem<2>(loss_scale_px, bundle));
  }
  if (num_intrinsics <= 4) {
    return solve(BundleProblem<4>(loss_scale_px, bundle));
  }
  if (num_intrinsics <= 8) {
    return solve(BundleProblem<8>(loss_scale_px, bundle));
  }
  return solve(BundleProblem<kMaxNumCameraParams>(loss_scale_px, bundle));
}

}  // namespace dgsfm
