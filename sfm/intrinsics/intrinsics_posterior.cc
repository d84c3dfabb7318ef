#include "sfm/intrinsics/intrinsics_posterior.h"

#include "colmap_ext/pose_access.h"
#include "estimators/optimization/point_elimination.h"
#include "estimators/optimization/reduced_system.h"
#include "sfm/intrinsics/posterior_columns.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

namespace dgsfm {

namespace {

// Information that every parameter has at least, relative to what it would have
// with all others known: images that share no track have no common scale, which
// must not hide what is known about all else.
constexpr double kDamping = 1e-11;
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

// The normal equations of poses, points and intrinsics at a model, and what
// follows from them.
class PosteriorProblem {
 public:
  PosteriorProblem(const BundleAdjustmentOptions& options,
                   const CameraBeliefs& beliefs,
                   const colmap::Reconstruction& model,
                   IntrinsicsBlocks blocks,
                   size_t max_num_images)
      : options_(options),
        model_(model),
        unknowns_(options.intrinsics, beliefs, model, blocks, max_num_images) {
    AddObservations();
  }

  std::optional<IntrinsicsPosterior> Solve() {
    const std::optional<double> unit_variance = UnitVariance();
    if (!unit_variance) return std::nullopt;
    Elimination elimination(
        index_,
        unknowns_.columns,
        [this](int k, Elimination::Row* row) { Linearize(k, row); },
        /*num_threads=*/1);
    ReducedSystem system(unknowns_.num_columns, [&](const auto& couple) {
      elimination.ForEachCoupling(couple);
    });
    Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(unknowns_.num_columns);
    Eigen::VectorXd gradient = diagonal;
    elimination.Accumulate(/*visitor=*/nullptr, &diagonal, &gradient);
    Eigen::VectorXd step = Eigen::VectorXd::Zero(unknowns_.num_columns);
    system.SetZero();
    elimination.Eliminate(kDamping, &system, &step);
    // The normal matrix has the weights, in units of this variance.
    for (const PosteriorColumns::Prior& prior : unknowns_.priors) {
      const double information = *unit_variance / (prior.stddev * prior.stddev);
      diagonal(prior.column) += information;
      system.Values()[system.EntryOf(prior.column, prior.column)] +=
          information;
      step(prior.column) -= information * prior.deviation;
    }
    for (int i = 0; i < unknowns_.num_columns; ++i) {
      // An image without observations leaves its pose open, no more.
      system.Values()[system.EntryOf(i, i)] +=
          kDamping * std::max(diagonal(i), 1.0);
    }
    return PosteriorFrom(elimination, step, *unit_variance, &system);
  }

 private:
  using Elimination = PointElimination<2, kNumPoseParams + kMaxNumCameraParams>;

  struct Observation {
    int image = 0;
    colmap::point2D_t point2D_idx = 0;
    // Weight by the soft L1 loss.
    double weight = 1;
    // Squared norm of the residual times its weight.
    double squared_norm = 0;
  };

  // Those of the chosen images that the camera models can project, of points
  // with two or more.
  void AddObservations() {
    index_.num_cameras = int(unknowns_.image_ids.size());
    for (const colmap::point3D_t point_id : SortedPoints(model_)) {
      std::vector<Observation> observations;
      for (const colmap::TrackElement& element :
           model_.Point3D(point_id).Track().Elements()) {
        const auto image = std::lower_bound(unknowns_.image_ids.begin(),
                                            unknowns_.image_ids.end(),
                                            element.image_id);
        Observation observation;
        observation.image = int(image - unknowns_.image_ids.begin());
        observation.point2D_idx = element.point2D_idx;
        if (image != unknowns_.image_ids.end() && *image == element.image_id &&
            Weigh(&observation)) {
          observations.push_back(observation);
        }
      }
      if (observations.size() < 2) continue;
      std::stable_sort(
          observations.begin(),
          observations.end(),
          [](const auto& a, const auto& b) { return a.image < b.image; });
      for (const Observation& observation : observations) {
        index_.cameras.push_back(observation.image);
        index_.points.push_back(index_.num_points);
        observations_.push_back(observation);
      }
      ++index_.num_points;
    }
  }

  // The point of the observation in the frame of its camera before the
  // translation, and where it is seen, with derivatives.
  bool Project(const Observation& observation,
               Eigen::Vector3d* rotated,
               Eigen::Vector2d* residual_px,
               ProjectionJacobian* by) const {
    const colmap::Image& image = ImageOf(observation.image);
    const colmap::Camera& camera = model_.Camera(image.CameraId());
    const colmap::Point2D& point2D = image.Point2D(observation.point2D_idx);
    const Rigid3d cam_from_world = CamFromWorld(image);
    *rotated =
        cam_from_world.rotation * model_.Point3D(point2D.Point3DId()).XYZ();
    if (!ProjectionOfModel(camera.ModelId())(
            camera.ParamsData(),
            *rotated + cam_from_world.translation,
            residual_px,
            by)) {
      return false;
    }
    *residual_px -= point2D.XY();
    return true;
  }

  // False if the camera model cannot project the point.
  bool Weigh(Observation* observation) const {
    Eigen::Vector3d rotated;
    Eigen::Vector2d residual_px;
    ProjectionJacobian by;
    if (!Project(*observation, &rotated, &residual_px, &by)) return false;
    const double loss_scale_px = kLossFactor * options_.loss_scale_px;
    observation->weight =
        1 / std::sqrt(1 + residual_px.squaredNorm() /
                              (loss_scale_px * loss_scale_px));
    observation->squared_norm =
        (std::sqrt(observation->weight) * residual_px).squaredNorm();
    return true;
  }

  // The residual, whitened by its weight.
  void Linearize(int k, Elimination::Row* row) const {
    const Observation& observation = observations_[size_t(k)];
    Eigen::Vector3d rotated;
    ProjectionJacobian by;
    Project(observation, &rotated, &row->residual, &by);
    const double root = std::sqrt(observation.weight);
    row->residual *= root;
    row->by_camera.setZero();
    const Rigid3d cam_from_world = CamFromWorld(ImageOf(observation.image));
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector3d by_point = root * by.point.row(i);
      row->by_camera.block<3, 1>(0, i) = rotated.cross(by_point);
      row->by_camera.block<3, 1>(3, i) = by_point;
      row->by_point.col(i) = cam_from_world.rotation.conjugate() * by_point;
    }
    const auto num_params =
        Eigen::Index(CameraOf(observation.image).NumParams());
    row->by_camera.middleRows(kNumPoseParams, num_params) =
        root * by.params.leftCols(num_params).transpose();
  }

  // Variance of the residuals that the weights are relative to (Huber, Robust
  // Statistics, Eq. 7.81); nothing without redundancy.
  std::optional<double> UnitVariance() const {
    double sum_weights = 0, sum_slopes = 0, sum_squared_influences = 0;
    for (size_t k = 0; k < observations_.size(); ++k) {
      const double weight = observations_[k].weight;
      sum_weights += weight;
      // Derivative of the influence of a residual, the mean of both directions.
      sum_slopes += (weight + weight * weight * weight) / 2;
      sum_squared_influences += weight * observations_[k].squared_norm;
    }
    const double count = double(observations_.size());
    const double redundancy =
        2 * count - unknowns_.num_columns - 3. * index_.num_points;
    if (!(redundancy > 0) || sum_squared_influences == 0) return std::nullopt;
    const double mean_slope = sum_slopes / count;
    return sum_weights / count * sum_squared_influences / redundancy /
           (mean_slope * mean_slope);
  }

  // From the free columns of all blocks to all parameters.
  std::optional<IntrinsicsPosterior> PosteriorFrom(
      const Elimination& elimination,
      const Eigen::VectorXd& right_side,
      double unit_variance,
      ReducedSystem* system) const {
    IntrinsicsPosterior posterior;
    std::vector<Eigen::Index> rows;
    std::vector<int> free_columns;
    std::vector<double> values;
    for (const auto& [block_id, block] : unknowns_.blocks) {
      posterior.first_params[block_id] = Eigen::Index(values.size());
      const colmap::Camera& camera = model_.Camera(block.camera_id);
      for (size_t i = 0; i < block.columns.size(); ++i) {
        if (block.columns[i] >= 0) {
          rows.push_back(Eigen::Index(values.size()));
          free_columns.push_back(block.columns[i]);
        }
        values.push_back(camera.Params(i));
      }
    }
    const auto count = Eigen::Index(rows.size());
    // The last column becomes the step, the others those of the inverse.
    Eigen::MatrixXd right_sides =
        Eigen::MatrixXd::Zero(unknowns_.num_columns, count + 1);
    for (Eigen::Index i = 0; i < count; ++i) {
      right_sides(free_columns[i], i) = 1;
    }
    right_sides.col(count) = right_side;
    Eigen::MatrixXd solution;
    if (!system->Solve(right_sides, &solution)) return std::nullopt;
    const Eigen::MatrixXd inverse = solution.leftCols(count);
    Eigen::MatrixXd inverse_block(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      inverse_block.row(i) = inverse.row(free_columns[i]);
    }
    const Covariances covariances = RealisticCovariances(
        elimination,
        inverse,
        unit_variance / 2 * (inverse_block + inverse_block.transpose()));

    const auto size = Eigen::Index(values.size());
    posterior.params = Eigen::Map<const Eigen::VectorXd>(values.data(), size);
    posterior.covariance = Eigen::MatrixXd::Zero(size, size);
    posterior.keypoint_covariance = Eigen::MatrixXd::Zero(size, size);
    for (Eigen::Index i = 0; i < count; ++i) {
      posterior.params(rows[i]) += solution(free_columns[i], count);
      for (Eigen::Index j = 0; j < count; ++j) {
        posterior.covariance(rows[i], rows[j]) = covariances.of_all(i, j);
        posterior.keypoint_covariance(rows[i], rows[j]) =
            covariances.of_keypoints(i, j);
      }
    }
    return posterior;
  }

  // Derivatives of the free columns by the residuals of the observations of a
  // point, up to their sign.
  std::vector<Eigen::MatrixX2d> InfluencesOf(
      const Elimination& elimination,
      const Eigen::MatrixXd& inverse,
      int point,
      const std::vector<Elimination::Row>& rows) const {
    std::vector<Eigen::MatrixX2d> influences;
    Eigen::MatrixX3d by_point = Eigen::MatrixX3d::Zero(inverse.cols(), 3);
    const int begin = elimination.PointBegin(point);
    for (int k = begin; k < elimination.PointEnd(point); ++k) {
      const Elimination::Row& row = rows[k - begin];
      Eigen::MatrixX2d& influence =
          influences.emplace_back(Eigen::MatrixX2d::Zero(inverse.cols(), 2));
      const Elimination::CameraColumns& columns =
          unknowns_.columns[observations_[k].image];
      for (size_t i = 0; i < columns.size(); ++i) {
        if (columns[i] < 0) continue;
        influence.noalias() += inverse.row(columns[i]).transpose() *
                               row.by_camera.row(Eigen::Index(i));
      }
      by_point.noalias() += influence * row.by_point.transpose();
    }
    Eigen::Matrix3d hessian =
        elimination.NormalEquations(point, rows.data()).first;
    hessian.diagonal() *= 1 + kDamping;
    by_point *= hessian.llt().solve(Eigen::Matrix3d::Identity());
    for (int k = begin; k < elimination.PointEnd(point); ++k) {
      influences[k - begin].noalias() -= by_point * rows[k - begin].by_point;
    }
    return influences;
  }

  // Covariances of the free columns, see EstimateIntrinsicsPosterior.
  struct Covariances {
    Eigen::MatrixXd of_keypoints;
    Eigen::MatrixXd of_all;
  };
  Covariances RealisticCovariances(const Elimination& elimination,
                                   const Eigen::MatrixXd& inverse,
                                   Eigen::MatrixXd covariance) const {
    const Eigen::Index count = inverse.cols();
    Eigen::VectorXd sandwich = Eigen::VectorXd::Zero(count);
    // Shifts by a unit coefficient of each smooth error, the monomials of the
    // horizontal errors first.
    using Shifts = Eigen::Matrix<double, Eigen::Dynamic, 2 * kNumMonomials>;
    std::map<int, Shifts> shifts;
    for (int point = 0; point < index_.num_points; ++point) {
      const int begin = elimination.PointBegin(point);
      std::vector<Elimination::Row> rows(elimination.PointEnd(point) - begin);
      for (size_t i = 0; i < rows.size(); ++i)
        Linearize(begin + int(i), &rows[i]);
      const std::vector<Eigen::MatrixX2d> influences =
          InfluencesOf(elimination, inverse, point, rows);
      Eigen::VectorXd shift = Eigen::VectorXd::Zero(count);
      for (size_t i = 0; i < influences.size(); ++i) {
        const Observation& observation = observations_[size_t(begin) + i];
        shift.noalias() += influences[i] * rows[i].residual;
        const auto image = shifts.try_emplace(
            observation.image, Shifts::Zero(count, 2 * kNumMonomials));
        const auto monomials = (std::sqrt(observation.weight) *
                                Monomials(CameraOf(observation.image),
                                          ImageOf(observation.image)
                                              .Point2D(observation.point2D_idx)
                                              .XY()))
                                   .eval();
        for (int axis = 0; axis < 2; ++axis) {
          image.first->second
              .template middleCols<kNumMonomials>(axis * kNumMonomials)
              .noalias() += influences[i].col(axis) * monomials.transpose();
        }
      }
      sandwich += shift.cwiseAbs2();
    }
    const Eigen::VectorXd factors =
        (sandwich.array() / covariance.diagonal().array()).max(1.0).sqrt();
    covariance = factors.asDiagonal() * covariance * factors.asDiagonal();
    const Eigen::MatrixXd of_keypoints = covariance;

    std::map<uint32_t, Shifts> common_shifts;
    for (const auto& [image, shift] : shifts) {
      const Shifts scaled =
          kSmoothErrorRatio * LargerSide(CameraOf(image)) * shift;
      covariance.noalias() += scaled * scaled.transpose();
      common_shifts
          .try_emplace(unknowns_.BlockOf(ImageOf(image)),
                       Shifts::Zero(count, 2 * kNumMonomials))
          .first->second += scaled;
    }
    for (const auto& [block_id, shift] : common_shifts) {
      covariance.noalias() += shift * shift.transpose();
    }
    return {of_keypoints, covariance};
  }

  const colmap::Image& ImageOf(int image) const {
    return model_.Image(unknowns_.image_ids[size_t(image)]);
  }
  const colmap::Camera& CameraOf(int image) const {
    return model_.Camera(ImageOf(image).CameraId());
  }

  const BundleAdjustmentOptions& options_;
  const colmap::Reconstruction& model_;
  const PosteriorColumns unknowns_;
  ObservationIndex index_;
  std::vector<Observation> observations_;
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
