#include "sfm/intrinsics/intrinsics_posterior.h"

#include "colmap_ext/pose_access.h"
#include "estimators/optimization/camera_projection.h"
#include "estimators/optimization/reduced_camera_system.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

namespace dgsfm {

namespace {

// Standard deviation of the poses that fix the gauge, of the image errors'
// unit: any value that is small against what the data say.
constexpr double kGaugeStddev = 1e-6;
constexpr int kNumPoseParams = 6;
// Scale of the soft L1 loss, of that of the adjustment: residuals of points
// that few images see follow so narrow a loss, and with it tell of less noise
// than there is.
constexpr double kLossFactor = 4;
// Standard deviation of the coefficients of smooth errors, of the larger image
// side [1]. With this, principal points that were freed on photos with ground
// truth were off by up to twice the stated standard deviation.
constexpr double kSmoothErrorRatio = 2e-4;
// Monomials of degree two and three in two coordinates.
constexpr int kNumMonomials = 7;

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d matrix;
  matrix << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return matrix;
}

// Monomials of the image coordinates, which are relative to the centre [half
// the larger side]. Those of degree zero and one are left out: rotations and
// focal lengths take most of them, and image errors of this kind are small.
Eigen::Matrix<double, kNumMonomials, 1> Monomials(
    const colmap::Camera& camera, const Eigen::Vector2d& xy_px) {
  const double unit_px =
      0.5 * double(std::max(camera.Width(), camera.Height()));
  const double x = (xy_px.x() - 0.5 * double(camera.Width())) / unit_px;
  const double y = (xy_px.y() - 0.5 * double(camera.Height())) / unit_px;
  Eigen::Matrix<double, kNumMonomials, 1> monomials;
  monomials << x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y;
  return monomials;
}

// At most so many images of a model: from the one with the most points, always
// the next that shares the most points with those chosen.
std::set<colmap::image_t> ChooseImages(const colmap::Reconstruction& model,
                                       size_t max_num_images) {
  std::map<colmap::image_t, size_t> num_shared;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    if (model.Image(image_id).NumPoints3D() > 0) num_shared[image_id] = 0;
  }
  std::set<colmap::image_t> chosen;
  if (num_shared.size() <= max_num_images) {
    for (const auto& [image_id, count] : num_shared) chosen.insert(image_id);
    return chosen;
  }
  const auto priority = [&](const auto& entry) {
    return std::make_pair(entry.second, model.Image(entry.first).NumPoints3D());
  };
  while (chosen.size() < max_num_images) {
    const auto best = std::max_element(num_shared.begin(),
                                       num_shared.end(),
                                       [&](const auto& a, const auto& b) {
                                         return priority(a) < priority(b);
                                       });
    const colmap::image_t image_id = best->first;
    num_shared.erase(best);
    chosen.insert(image_id);
    for (const colmap::Point2D& point2D : model.Image(image_id).Points2D()) {
      if (!point2D.HasPoint3D()) continue;
      for (const colmap::TrackElement& element :
           model.Point3D(point2D.Point3DId()).Track().Elements()) {
        const auto it = num_shared.find(element.image_id);
        if (it != num_shared.end()) ++it->second;
      }
    }
  }
  return chosen;
}

class PosteriorProblem {
 public:
  PosteriorProblem(const BundleAdjustmentOptions& options,
                   const CameraBeliefs& beliefs,
                   const colmap::Reconstruction& model,
                   IntrinsicsBlocks blocks,
                   size_t max_num_images)
      : options_(options), beliefs_(beliefs), model_(model), blocks_(blocks) {
    for (const colmap::image_t image_id : ChooseImages(model, max_num_images)) {
      first_pose_param_[image_id] = num_params_;
      num_params_ += kNumPoseParams;
      const colmap::Image& image = model.Image(image_id);
      Block& block = intrinsics_[BlockOf(image)];
      if (block.camera_id == colmap::kInvalidCameraId) {
        block.camera_id = CameraIdOf(image);
      }
    }
    for (auto& [block_id, block] : intrinsics_) AddIntrinsics(&block);
  }

  std::optional<IntrinsicsPosterior> Solve() {
    ReducedCameraSystem system(num_params_);
    const std::vector<colmap::point3D_t> point_ids = SortedPoints(model_);
    size_t num_points = 0;
    for (const colmap::point3D_t point_id : point_ids) {
      const std::vector<Observation> observations = ObservationsOf(point_id);
      for (const Observation& observation : observations) Count(observation);
      system.AddPoint(LinearizedOf(observations));
      num_points += !observations.empty();
    }
    const double redundancy =
        2 * double(num_observations_) - num_params_ - 3 * double(num_points);
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
    FixGauge(&system);
    std::vector<int> free_params;
    for (const auto& [block_id, block] : intrinsics_) {
      for (const int param : block.params) {
        if (param >= 0) free_params.push_back(param);
      }
    }
    const auto marginal = system.MarginalOf(free_params);
    if (!marginal) return std::nullopt;
    return PosteriorFrom(*marginal,
                         RealisticCovariances(*marginal, unit_variance));
  }

 private:
  struct Prior {
    int param = 0;
    double stddev = 0;
    // Deviation of the model's value from the mean.
    double deviation = 0;
  };

  // Intrinsics that some images share.
  struct Block {
    // Their camera, of a group the first.
    colmap::camera_t camera_id = colmap::kInvalidCameraId;
    // Indices of the parameters; -1 where held.
    std::vector<int> params;
  };

  struct Observation {
    colmap::image_t image_id = colmap::kInvalidImageId;
    Eigen::Vector2d xy_px;
    // Before weighting [px].
    Eigen::Vector2d residual_px;
    // Weight by the soft L1 loss.
    double weight = 1;
    LinearizedObservation linearized;
  };

  colmap::camera_t CameraIdOf(const colmap::Image& image) const {
    if (blocks_ == IntrinsicsBlocks::BY_IMAGE) return image.CameraId();
    return beliefs_.FirstOfGroup(image.CameraId());
  }

  uint32_t BlockOf(const colmap::Image& image) const {
    return blocks_ == IntrinsicsBlocks::BY_IMAGE ? image.ImageId()
                                                 : CameraIdOf(image);
  }

  void AddIntrinsics(Block* block) {
    const Eigen::VectorXd stddevs =
        PriorStddevs(options_.intrinsics, beliefs_, block->camera_id);
    const colmap::Camera& camera = model_.Camera(block->camera_id);
    const Eigen::VectorXd deviations =
        Eigen::Map<const Eigen::VectorXd>(camera.ParamsData(), stddevs.size()) -
        PriorMean(beliefs_, block->camera_id);
    for (const double stddev : stddevs) {
      block->params.push_back(stddev == 0 ? -1 : num_params_++);
    }
    for (const RobustPrior& prior :
         SplitPriors(options_.intrinsics, beliefs_, block->camera_id)) {
      // A Cauchy loss weakens the prior of values far off.
      double squared_distance = 0;
      for (const Eigen::Index i : prior.idxs) {
        squared_distance += std::pow(deviations(i) / stddevs(i), 2);
      }
      const double loosening = std::sqrt(
          1 + squared_distance / (prior.loss_scale * prior.loss_scale));
      for (const Eigen::Index i : prior.idxs) {
        priors_.push_back(
            {block->params[size_t(i)], stddevs(i) * loosening, deviations(i)});
      }
    }
  }

  // Those of the chosen images that the camera models can project.
  std::vector<Observation> ObservationsOf(colmap::point3D_t point_id) const {
    std::vector<Observation> observations;
    for (const colmap::TrackElement& element :
         model_.Point3D(point_id).Track().Elements()) {
      if (first_pose_param_.count(element.image_id) == 0) continue;
      Observation observation;
      if (Linearize(element, &observation)) {
        observations.push_back(std::move(observation));
      }
    }
    // A point with one observation does not constrain the cameras.
    if (observations.size() < 2) observations.clear();
    return observations;
  }

  static std::vector<LinearizedObservation> LinearizedOf(
      const std::vector<Observation>& observations) {
    std::vector<LinearizedObservation> linearized;
    for (const Observation& observation : observations) {
      linearized.push_back(observation.linearized);
    }
    return linearized;
  }

  void Count(const Observation& observation) {
    const double weight = observation.weight;
    ++num_observations_;
    sum_weights_ += weight;
    sum_slopes_ += (weight + weight * weight * weight) / 2;
    sum_squared_influences_ +=
        weight * weight * observation.residual_px.squaredNorm();
  }

  bool Linearize(const colmap::TrackElement& element,
                 Observation* observation) const {
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
      return false;
    }
    observation->image_id = element.image_id;
    observation->xy_px = point2D.XY();
    observation->residual_px = projection - point2D.XY();
    const double loss_scale_px = kLossFactor * options_.loss_scale_px;
    observation->weight =
        1 / std::sqrt(1 + observation->residual_px.squaredNorm() /
                              (loss_scale_px * loss_scale_px));

    LinearizedObservation& linearized = observation->linearized;
    const double root = std::sqrt(observation->weight);
    linearized.residual = root * observation->residual_px;
    linearized.point_jacobian =
        root * by.point * cam_from_world.rotation.toRotationMatrix();
    Eigen::Matrix<double, 2, kNumPoseParams> by_pose;
    by_pose << -by.point *
                   CrossMatrix(point_in_cam - cam_from_world.translation),
        by.point;
    const int first_pose_param = first_pose_param_.at(element.image_id);
    const std::vector<int>& intrinsics = intrinsics_.at(BlockOf(image)).params;
    auto& jacobian = linearized.camera_jacobian;
    jacobian.resize(2, kNumPoseParams + Eigen::Index(intrinsics.size()));
    jacobian.leftCols<kNumPoseParams>() = root * by_pose;
    for (int i = 0; i < kNumPoseParams; ++i) {
      linearized.params.push_back(first_pose_param + i);
    }
    for (size_t i = 0; i < intrinsics.size(); ++i) {
      if (intrinsics[i] < 0) continue;
      jacobian.col(Eigen::Index(linearized.params.size())) =
          root * by.params.col(Eigen::Index(i));
      linearized.params.push_back(intrinsics[i]);
    }
    jacobian.conservativeResize(2, Eigen::Index(linearized.params.size()));
    return true;
  }

  // Covariances of the free parameters, see EstimateIntrinsicsPosterior.
  struct Covariances {
    Eigen::MatrixXd of_keypoints;
    Eigen::MatrixXd of_all;
  };
  Covariances RealisticCovariances(
      const ReducedCameraSystem::Marginal& marginal,
      double unit_variance) const {
    const Eigen::Index count = marginal.step.size();
    Eigen::VectorXd sandwich = Eigen::VectorXd::Zero(count);
    // Shifts by a unit coefficient of each smooth error, the monomials of the
    // horizontal errors first.
    using Shifts = Eigen::Matrix<double, Eigen::Dynamic, 2 * kNumMonomials>;
    std::map<colmap::image_t, Shifts> shifts;
    for (const colmap::point3D_t point_id : SortedPoints(model_)) {
      const std::vector<Observation> observations = ObservationsOf(point_id);
      const std::vector<Eigen::MatrixX2d> influences =
          ReducedCameraSystem::InfluencesOf(marginal,
                                            LinearizedOf(observations));
      Eigen::VectorXd shift = Eigen::VectorXd::Zero(count);
      for (size_t k = 0; k < influences.size(); ++k) {
        const Observation& observation = observations[k];
        shift.noalias() += influences[k] * observation.linearized.residual;
        const auto image = shifts.try_emplace(
            observation.image_id, Shifts::Zero(count, 2 * kNumMonomials));
        const auto monomials =
            (std::sqrt(observation.weight) *
             Monomials(CameraOf(observation.image_id), observation.xy_px))
                .eval();
        for (int i = 0; i < 2; ++i) {
          image.first->second
              .template middleCols<kNumMonomials>(i * kNumMonomials)
              .noalias() += influences[k].col(i) * monomials.transpose();
        }
      }
      sandwich += shift.cwiseAbs2();
    }
    Eigen::MatrixXd covariance = unit_variance * marginal.covariance;
    const Eigen::VectorXd factors =
        (sandwich.array() / covariance.diagonal().array()).max(1.0).sqrt();
    covariance = factors.asDiagonal() * covariance * factors.asDiagonal();
    const Eigen::MatrixXd of_keypoints = covariance;

    std::map<uint32_t, Shifts> common_shifts;
    for (const auto& [image_id, shift] : shifts) {
      const double stddev_px =
          kSmoothErrorRatio * LargerSide(CameraOf(image_id));
      const Shifts scaled = stddev_px * shift;
      covariance.noalias() += scaled * scaled.transpose();
      common_shifts
          .try_emplace(BlockOf(model_.Image(image_id)),
                       Shifts::Zero(count, 2 * kNumMonomials))
          .first->second += scaled;
    }
    for (const auto& [block_id, shift] : common_shifts) {
      covariance.noalias() += shift * shift.transpose();
    }
    return {of_keypoints, covariance};
  }

  const colmap::Camera& CameraOf(colmap::image_t image_id) const {
    return model_.Camera(model_.Image(image_id).CameraId());
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

  // From the free parameters to all.
  IntrinsicsPosterior PosteriorFrom(
      const ReducedCameraSystem::Marginal& marginal,
      const Covariances& covariances) const {
    IntrinsicsPosterior posterior;
    std::vector<Eigen::Index> rows;
    std::vector<double> values;
    for (const auto& [block_id, block] : intrinsics_) {
      posterior.first_params[block_id] = Eigen::Index(values.size());
      const colmap::Camera& camera = model_.Camera(block.camera_id);
      for (size_t i = 0; i < block.params.size(); ++i) {
        if (block.params[i] >= 0) rows.push_back(Eigen::Index(values.size()));
        values.push_back(camera.Params(i));
      }
    }
    const auto size = Eigen::Index(values.size());
    posterior.params = Eigen::Map<const Eigen::VectorXd>(values.data(), size);
    posterior.covariance = Eigen::MatrixXd::Zero(size, size);
    posterior.keypoint_covariance = Eigen::MatrixXd::Zero(size, size);
    for (Eigen::Index i = 0; i < marginal.step.size(); ++i) {
      posterior.params(rows[i]) += marginal.step(i);
      for (Eigen::Index j = 0; j < marginal.step.size(); ++j) {
        posterior.covariance(rows[i], rows[j]) = covariances.of_all(i, j);
        posterior.keypoint_covariance(rows[i], rows[j]) =
            covariances.of_keypoints(i, j);
      }
    }
    return posterior;
  }

  const BundleAdjustmentOptions& options_;
  const CameraBeliefs& beliefs_;
  const colmap::Reconstruction& model_;
  const IntrinsicsBlocks blocks_;
  // First pose parameter of each chosen image.
  std::map<colmap::image_t, int> first_pose_param_;
  std::map<uint32_t, Block> intrinsics_;
  std::vector<Prior> priors_;
  int num_params_ = 0;
  size_t num_observations_ = 0;
  double sum_weights_ = 0;
  // Derivatives of the influence of a residual, the mean of both directions.
  double sum_slopes_ = 0;
  double sum_squared_influences_ = 0;
};

}  // namespace

std::optional<IntrinsicsPosterior> EstimateIntrinsicsPosterior(
    const BundleAdjustmentOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model,
    IntrinsicsBlocks blocks,
    size_t max_num_images) {
  if (model.NumPoints3D() == 0) return std::nullopt;
  return PosteriorProblem(options, beliefs, model, blocks, max_num_images)
      .Solve();
}

}  // namespace dgsfm
