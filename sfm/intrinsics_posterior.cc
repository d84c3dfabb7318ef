#include "sfm/intrinsics_posterior.h"

#include "colmap_ext/pose_access.h"
#include "estimators/camera_projection.h"
#include "estimators/reduced_camera_system.h"
#include "sfm/model_access.h"

#include <algorithm>
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
// Scale of the soft L1 loss, of that of the adjustment: residuals of points
// that few images see follow so narrow a loss, and with it tell of less noise
// than there is.
constexpr double kLossFactor = 4;

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d matrix;
  matrix << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return matrix;
}

class PosteriorProblem {
 public:
  PosteriorProblem(const BundleAdjustmentOptions& options,
                   const CameraBeliefs& beliefs,
                   const colmap::Reconstruction& model)
      : options_(options), beliefs_(beliefs), model_(model) {
    for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
      const colmap::Image& image = model.Image(image_id);
      if (image.NumPoints3D() == 0) continue;
      first_pose_param_[image_id] = num_params_;
      num_params_ += kNumPoseParams;
      intrinsic_params_[BlockOf(image.CameraId())];
    }
    for (auto& [block, params] : intrinsic_params_) {
      AddIntrinsics(block, &params);
    }
    for (const CameraGroup& group : beliefs.groups) AddTies(group);
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
    for (const Prior& prior : priors_) {
      system.AddPrior(prior.param,
                      prior.stddev / std::sqrt(unit_variance),
                      prior.deviation);
    }
    for (const Tie& tie : ties_) {
      system.AddTie(tie.param,
                    tie.mean_param,
                    tie.stddev / std::sqrt(unit_variance),
                    tie.difference);
    }
    FixGauge(&system);
    std::optional<IntrinsicsPosterior> posterior =
        PosteriorFrom(system, unit_variance);
    if (posterior) posterior->keypoint_stddev_px = std::sqrt(variance);
    return posterior;
  }

 private:
  struct Prior {
    int param = 0;
    double stddev = 0;
    // Of the model's value from the mean.
    double deviation = 0;
  };

  // Of a parameter to the mean of its group.
  struct Tie {
    int param = 0;
    int mean_param = 0;
    double stddev = 0;
    double difference = 0;
  };

  colmap::camera_t BlockOf(colmap::camera_t camera_id) const {
    const CameraGroup* group = beliefs_.RigidGroupOf(camera_id);
    return group ? group->camera_ids.front() : camera_id;
  }

  void AddIntrinsics(colmap::camera_t block, std::vector<int>* params) {
    const Eigen::VectorXd stddevs =
        PriorStddevs(options_.intrinsics, beliefs_, block);
    const colmap::Camera& given = beliefs_.given.at(block);
    const colmap::Camera& camera = model_.Camera(block);
    std::vector<double> deviations;
    for (size_t i = 0; i < camera.NumParams(); ++i) {
      deviations.push_back(camera.Params(i) - given.Params(i));
    }
    // The Cauchy loss of principal points weakens their prior.
    double squared_distance = 0;
    for (const size_t idx : camera.PrincipalPointIdxs()) {
      if (stddevs(Eigen::Index(idx)) == 0) continue;
      const double ratio = deviations[idx] / stddevs(Eigen::Index(idx));
      squared_distance += ratio * ratio;
    }
    const double factor = options_.intrinsics.crop_factor;
    const double loosening =
        std::sqrt(1 + squared_distance / (factor * factor));
    for (Eigen::Index i = 0; i < stddevs.size(); ++i) {
      params->push_back(stddevs(i) == 0 ? -1 : num_params_++);
      if (stddevs(i) == 0 || !std::isfinite(stddevs(i))) continue;
      const std::vector<size_t>& centers = camera.PrincipalPointIdxs();
      const bool is_center =
          std::find(centers.begin(), centers.end(), size_t(i)) != centers.end();
      priors_.push_back({params->back(),
                         stddevs(i) * (is_center ? loosening : 1),
                         deviations[size_t(i)]});
    }
  }

  void AddTies(const CameraGroup& group) {
    if (group.IsRigid()) return;
    const std::vector<double> mean = MeanParams(group, model_);
    for (size_t i = 0; i < mean.size(); ++i) {
      if (group.stddevs(Eigen::Index(i)) == 0) continue;
      int mean_param = -1;
      for (const colmap::camera_t camera_id : group.camera_ids) {
        const auto params = intrinsic_params_.find(camera_id);
        if (params == intrinsic_params_.end() || params->second[i] < 0) {
          continue;
        }
        if (mean_param < 0) mean_param = num_params_++;
        ties_.push_back({params->second[i],
                         mean_param,
                         group.stddevs(Eigen::Index(i)),
                         model_.Camera(camera_id).Params(i) - mean[i]});
      }
    }
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
    const double loss_scale_px = kLossFactor * options_.loss_scale_px;
    const double weight =
        1 /
        std::sqrt(1 + residual.squaredNorm() / (loss_scale_px * loss_scale_px));
    ++num_observations_;
    sum_weights_ += weight;
    sum_slopes_ += (weight + weight * weight * weight) / 2;
    sum_squared_influences_ += weight * weight * residual.squaredNorm();

    LinearizedObservation observation;
    const double root = std::sqrt(weight);
    observation.residual = root * residual;
    observation.point_jacobian =
        root * by.point * cam_from_world.rotation.toRotationMatrix();
    Eigen::Matrix<double, 2, kNumPoseParams> by_pose;
    by_pose << -by.point *
                   CrossMatrix(point_in_cam - cam_from_world.translation),
        by.point;
    const int first_pose_param = first_pose_param_.at(element.image_id);
    const std::vector<int>& intrinsics =
        intrinsic_params_.at(BlockOf(image.CameraId()));
    auto& jacobian = observation.camera_jacobian;
    jacobian.resize(2, kNumPoseParams + Eigen::Index(intrinsics.size()));
    jacobian.leftCols<kNumPoseParams>() = root * by_pose;
    for (int i = 0; i < kNumPoseParams; ++i) {
      observation.params.push_back(first_pose_param + i);
    }
    for (size_t i = 0; i < intrinsics.size(); ++i) {
      if (intrinsics[i] < 0) continue;
      jacobian.col(Eigen::Index(observation.params.size())) =
          root * by.params.col(Eigen::Index(i));
      observation.params.push_back(intrinsics[i]);
    }
    jacobian.conservativeResize(2, Eigen::Index(observation.params.size()));
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
    const auto marginal = system.MarginalOf(free_params);
    if (!marginal) return std::nullopt;
    for (size_t i = 0; i < rows.size(); ++i) {
      posterior.params(rows[i]) += marginal->step(Eigen::Index(i));
      for (size_t j = 0; j < rows.size(); ++j) {
        posterior.covariance(rows[i], rows[j]) =
            variance * marginal->covariance(Eigen::Index(i), Eigen::Index(j));
      }
    }
    return posterior;
  }

  const BundleAdjustmentOptions& options_;
  const CameraBeliefs& beliefs_;
  const colmap::Reconstruction& model_;
  std::map<colmap::image_t, int> first_pose_param_;
  // Of each block; -1 where held.
  std::map<colmap::camera_t, std::vector<int>> intrinsic_params_;
  std::vector<Prior> priors_;
  std::vector<Tie> ties_;
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
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  if (model.NumPoints3D() == 0 || model.NumRegImages() > kMaxNumDenseImages) {
    return std::nullopt;
  }
  return PosteriorProblem(options, beliefs, model).Solve();
}

}  // namespace dgsfm
