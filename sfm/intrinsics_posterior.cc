#include "sfm/intrinsics_posterior.h"

#include "colmap_ext/pose_access.h"
#include "estimators/camera_projection.h"
#include "estimators/reduced_camera_system.h"
#include "sfm/model_access.h"

#include <cmath>
#include <map>
#include <utility>

namespace dgsfm {

namespace {

// Images up to which the Schur complement is kept dense.
constexpr size_t kMaxNumDenseImages = 400;
// Standard deviation of the poses that fix the gauge, of the image errors'
// unit: any value that is small against what the data say.
constexpr double kGaugeStddev = 1e-6;
constexpr int kNumPoseParams = 6;

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d matrix;
  matrix << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return matrix;
}

class PosteriorProblem {
 public:
  PosteriorProblem(const BundleAdjustmentOptions& options,
                   const CameraMap& prior_cameras,
                   const std::vector<CameraGroup>& groups,
                   const colmap::Reconstruction& model)
      : options_(options), model_(model) {
    for (const CameraGroup& group : groups) {
      if (!group.IsRigid()) continue;
      for (const colmap::camera_t camera_id : group.camera_ids) {
        first_of_group_[camera_id] = group.camera_ids.front();
      }
    }
    std::map<colmap::camera_t, Eigen::VectorXd> stddevs;
    for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
      const colmap::Image& image = model.Image(image_id);
      if (image.NumPoints3D() == 0) continue;
      first_pose_param_[image_id] = num_params_;
      num_params_ += kNumPoseParams;
      const colmap::camera_t block = BlockOf(image.CameraId());
      stddevs[block] =
          PriorStddevs(options.intrinsics, prior_cameras.at(block));
    }
    for (const auto& [block, block_stddevs] : stddevs) {
      std::vector<int>& params = intrinsic_params_[block];
      for (const double stddev : block_stddevs) {
        params.push_back(stddev == 0 ? -1 : num_params_++);
        if (stddev > 0 && std::isfinite(stddev)) {
          priors_.emplace_back(params.back(), stddev);
        }
      }
    }
  }

  std::optional<IntrinsicsPosterior> Solve() {
    ReducedCameraSystem system(num_params_);
    const std::vector<colmap::point3D_t> point_ids = SortedPoints(model_);
    for (const colmap::point3D_t point_id : point_ids) {
      std::vector<LinearizedObservation> observations;
      for (const colmap::TrackElement& element :
           model_.Point3D(point_id).Track().Elements()) {
        observations.push_back(Linearize(element));
        if (observations.back().params.empty()) observations.pop_back();
      }
      system.AddPoint(observations);
    }
    const double redundancy = 2 * double(num_observations_) - num_params_ -
                              3 * double(point_ids.size());
    if (!(redundancy > 0) || sum_squared_influences_ == 0) return std::nullopt;
    const double count = double(num_observations_);
    const double mean_weight = sum_weights_ / count;
    const double mean_slope = sum_slopes_ / count;
    const double variance =
        sum_squared_influences_ / redundancy / (mean_slope * mean_slope);
    // The normal matrix has the weights.
    const double unit_variance = mean_weight * variance;
    for (const auto& [param, stddev] : priors_) {
      system.AddPrior(param, stddev / std::sqrt(unit_variance));
    }
    FixGauge(&system);
    std::optional<IntrinsicsPosterior> posterior =
        PosteriorFrom(system, unit_variance);
    if (posterior) posterior->keypoint_stddev_px = std::sqrt(variance);
    return posterior;
  }

 private:
  colmap::camera_t BlockOf(colmap::camera_t camera_id) const {
    const auto group = first_of_group_.find(camera_id);
    return group == first_of_group_.end() ? camera_id : group->second;
  }

  LinearizedObservation Linearize(const colmap::TrackElement& element) {
    const colmap::Image& image = model_.Image(element.image_id);
    const colmap::Camera& camera = model_.Camera(image.CameraId());
    const colmap::Point2D& point2D = image.Point2D(element.point2D_idx);
    const Rigid3d cam_from_world = CamFromWorld(image);
    const Eigen::Vector3d point_in_cam =
        cam_from_world * model_.Point3D(point2D.Point3DId()).XYZ();
    Eigen::Vector2d projection;
    ProjectionJacobian by;
    if (!ProjectionOfModel(camera.ModelId())(
            camera.ParamsData(), point_in_cam, &projection, &by)) {
      return {};
    }
    const Eigen::Vector2d residual = projection - point2D.XY();

    // Of the soft L1 loss.
    const double weight =
        1 / std::sqrt(1 + residual.squaredNorm() / (options_.loss_scale_px *
                                                    options_.loss_scale_px));
    ++num_observations_;
    sum_weights_ += weight;
    sum_slopes_ += (weight + weight * weight * weight) / 2;
    sum_squared_influences_ += weight * weight * residual.squaredNorm();

    LinearizedObservation observation;
    const double root = std::sqrt(weight);
    observation.point_jacobian =
        root * by.point * cam_from_world.rotation.toRotationMatrix();
    const auto num_intrinsics = Eigen::Index(camera.NumParams());
    Eigen::Matrix2Xd jacobian(2, kNumPoseParams + num_intrinsics);
    jacobian << -by.point *
                    CrossMatrix(point_in_cam - cam_from_world.translation),
        by.point, by.params.leftCols(num_intrinsics);
    std::vector<int> params;
    for (int i = 0; i < kNumPoseParams; ++i) {
      params.push_back(first_pose_param_.at(element.image_id) + i);
    }
    const std::vector<int>& intrinsics =
        intrinsic_params_.at(BlockOf(image.CameraId()));
    params.insert(params.end(), intrinsics.begin(), intrinsics.end());
    observation.camera_jacobian.resize(2, 0);
    for (size_t i = 0; i < params.size(); ++i) {
      if (params[i] < 0) continue;
      const Eigen::Index column = observation.camera_jacobian.cols();
      observation.camera_jacobian.conservativeResize(2, column + 1);
      observation.camera_jacobian.col(column) =
          root * jacobian.col(Eigen::Index(i));
      observation.params.push_back(params[i]);
    }
    return observation;
  }

  // Holds the first pose, and the distance of the farthest image from it.
  void FixGauge(ReducedCameraSystem* system) const {
    const auto hold = [&](int param) { system->AddPrior(param, kGaugeStddev); };
    const auto& [first_id, first_param] = *first_pose_param_.begin();
    for (int i = 0; i < kNumPoseParams; ++i) hold(first_param + i);
    const Eigen::Vector3d center =
        CamFromWorld(model_.Image(first_id)).TargetOriginInSource();
    int farthest = first_param;
    int coordinate = 0;
    double max_distance = 0;
    for (const auto& [image_id, param] : first_pose_param_) {
      const Rigid3d cam_from_world = CamFromWorld(model_.Image(image_id));
      const double distance =
          (cam_from_world.TargetOriginInSource() - center).norm();
      if (distance <= max_distance) continue;
      max_distance = distance;
      farthest = param;
      // The scale moves the camera along this direction.
      (cam_from_world * center).cwiseAbs().maxCoeff(&coordinate);
    }
    hold(farthest + 3 + coordinate);
  }

  std::optional<IntrinsicsPosterior> PosteriorFrom(
      const ReducedCameraSystem& system, double variance) const {
    IntrinsicsPosterior posterior;
    std::vector<int> rows;
    std::vector<int> free_params;
    std::vector<double> values;
    for (const auto& [camera_id, params] : intrinsic_params_) {
      posterior.camera_ids.push_back(camera_id);
      for (size_t i = 0; i < params.size(); ++i) {
        if (params[i] >= 0) {
          rows.push_back(int(values.size()));
          free_params.push_back(params[i]);
        }
        values.push_back(model_.Camera(camera_id).Params(i));
      }
    }
    const auto size = Eigen::Index(values.size());
    posterior.params = Eigen::Map<const Eigen::VectorXd>(values.data(), size);
    posterior.covariance = Eigen::MatrixXd::Zero(size, size);
    const Eigen::MatrixXd covariance =
        MarginalCovariance(system.Information(), free_params);
    if (covariance.size() == 0 && !free_params.empty()) return std::nullopt;
    for (size_t i = 0; i < rows.size(); ++i) {
      for (size_t j = 0; j < rows.size(); ++j) {
        posterior.covariance(rows[i], rows[j]) =
            variance * covariance(Eigen::Index(i), Eigen::Index(j));
      }
    }
    return posterior;
  }

  const BundleAdjustmentOptions& options_;
  const colmap::Reconstruction& model_;
  std::map<colmap::camera_t, colmap::camera_t> first_of_group_;
  std::map<colmap::image_t, int> first_pose_param_;
  // Of each block; -1 where held.
  std::map<colmap::camera_t, std::vector<int>> intrinsic_params_;
  std::vector<std::pair<int, double>> priors_;
  int num_params_ = 0;
  size_t num_observations_ = 0;
  double sum_weights_ = 0;
  // Derivatives of the influence of a residual, the mean of both directions.
  double sum_slopes_ = 0;
  double sum_squared_influences_ = 0;
};

}  // namespace

Eigen::VectorXd IntrinsicsPosterior::StddevsOf(
    colmap::camera_t camera_id, const colmap::Reconstruction& model) const {
  Eigen::Index first = 0;
  for (const colmap::camera_t other_id : camera_ids) {
    const auto num_params = Eigen::Index(model.Camera(other_id).NumParams());
    if (other_id == camera_id) {
      return covariance.diagonal().segment(first, num_params).cwiseSqrt();
    }
    first += num_params;
  }
  return {};
}

std::optional<IntrinsicsPosterior> EstimateIntrinsicsPosterior(
    const BundleAdjustmentOptions& options,
    const CameraMap& prior_cameras,
    const std::vector<CameraGroup>& groups,
    const colmap::Reconstruction& model) {
  if (model.NumPoints3D() == 0 || model.NumRegImages() > kMaxNumDenseImages) {
    return std::nullopt;
  }
  return PosteriorProblem(options, prior_cameras, groups, model).Solve();
}

}  // namespace dgsfm
