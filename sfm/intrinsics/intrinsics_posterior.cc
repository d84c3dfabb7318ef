#include "sfm/intrinsics/intrinsics_posterior.h"

#include "colmap_ext/parallel.h"
#include "estimators/optimization/reduced_system.h"
#include "sfm/intrinsics/posterior_columns.h"
#include "sfm/intrinsics/posterior_observations.h"
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
// side [1]. With this, principal points of photos with ground truth are off by
// half of the stated standard deviation (root mean square).
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
                   int num_threads,
                   const CameraBeliefs& beliefs,
                   const colmap::Reconstruction& model,
                   IntrinsicsBlocks blocks,
                   size_t max_num_images)
      : num_threads_(EffectiveNumThreads(num_threads)),
        model_(model),
        unknowns_(options.intrinsics, beliefs, model, blocks, max_num_images),
        observed_(
            kLossFactor * options.loss_scale_px, unknowns_.image_ids, model) {}

  std::optional<IntrinsicsPosterior> Solve() {
    const std::optional<double> unit_variance = UnitVariance();
    if (!unit_variance) return std::nullopt;
    Elimination elimination(
        observed_.index,
        unknowns_.columns,
        [this](int k, Elimination::Row* row) { observed_.Linearize(k, row); },
        num_threads_);
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
  using Elimination = PosteriorObservations::Elimination;

  // Variance of the residuals that the weights are relative to (Huber, Robust
  // Statistics, Eq. 7.81); nothing without redundancy.
  std::optional<double> UnitVariance() const {
    double sum_weights = 0, sum_slopes = 0, sum_squared_influences = 0;
    for (const auto& observation : observed_.observations) {
      const double weight = observation.weight;
      sum_weights += weight;
      // Derivative of the influence of a residual, the mean of both directions.
      sum_slopes += (weight + weight * weight * weight) / 2;
      sum_squared_influences += weight * observation.squared_norm;
    }
    const double count = double(observed_.observations.size());
    const double redundancy =
        2 * count - unknowns_.num_columns - 3. * observed_.index.num_points;
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

    for (const colmap::image_t image_id : unknowns_.image_ids) {
      ++posterior.num_images[unknowns_.BlockOf(model_.Image(image_id))];
    }
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

  // What errors of the images shift the free columns by, a row each.
  struct Shifts {
    // Sum of the squared shifts by the residuals of each point.
    Eigen::VectorXd sandwich;
    // By a unit coefficient of each smooth error of each image, in rows: the
    // monomials of the horizontal errors first.
    std::vector<Eigen::Matrix<double, 2 * kNumMonomials, Eigen::Dynamic>>
        by_image;
  };

  // Derivatives of free columns, those of the rows of the transposed inverse,
  // by the residuals of the observations of a point, up to their sign. Products
  // are written out by columns: matrices this narrow are faster so, and each
  // row is the same with any others.
  template <typename Rows>
  void InfluencesOf(const Elimination& elimination,
                    const Rows& inverse,
                    int point,
                    const std::vector<Elimination::Row>& rows,
                    std::vector<Eigen::MatrixX2d>* influences) const {
    Eigen::MatrixX3d by_point = Eigen::MatrixX3d::Zero(inverse.rows(), 3);
    for (size_t k = 0; k < rows.size(); ++k) {
      const Elimination::Row& row = rows[k];
      Eigen::MatrixX2d& influence = (*influences)[k];
      influence.setZero(inverse.rows(), 2);
      const Elimination::CameraColumns& columns =
          unknowns_.columns
              [observed_.observations[size_t(elimination.PointBegin(point)) + k]
                   .image];
      for (size_t i = 0; i < columns.size(); ++i) {
        if (columns[i] < 0) continue;
        for (int axis = 0; axis < 2; ++axis) {
          influence.col(axis) +=
              row.by_camera(Eigen::Index(i), axis) * inverse.col(columns[i]);
        }
      }
      for (int i = 0; i < 3; ++i) {
        by_point.col(i) += influence.col(0) * row.by_point(i, 0) +
                           influence.col(1) * row.by_point(i, 1);
      }
    }
    Eigen::Matrix3d hessian =
        elimination.NormalEquations(point, rows.data()).first;
    hessian.diagonal() *= 1 + kDamping;
    const Eigen::Matrix3d inverse_hessian =
        hessian.llt().solve(Eigen::Matrix3d::Identity());
    for (size_t k = 0; k < rows.size(); ++k) {
      const Eigen::Matrix<double, 3, 2> factor =
          inverse_hessian * rows[k].by_point;
      for (int axis = 0; axis < 2; ++axis) {
        (*influences)[k].col(axis) -= by_point.col(0) * factor(0, axis) +
                                      by_point.col(1) * factor(1, axis) +
                                      by_point.col(2) * factor(2, axis);
      }
    }
  }

  // Fills in the shifts of a range of the free columns.
  void FindShifts(const Elimination& elimination,
                  const Eigen::MatrixXd& transposed_inverse,
                  Eigen::Index begin,
                  Eigen::Index size,
                  Shifts* shifts) const {
    const auto inverse = transposed_inverse.middleRows(begin, size);
    std::vector<Elimination::Row> rows;
    std::vector<Eigen::MatrixX2d> influences;
    Eigen::VectorXd shift(size);
    for (int point = 0; point < observed_.index.num_points; ++point) {
      const int first = elimination.PointBegin(point);
      rows.resize(size_t(elimination.PointEnd(point) - first));
      if (influences.size() < rows.size()) influences.resize(rows.size());
      for (size_t k = 0; k < rows.size(); ++k) {
        observed_.Linearize(first + int(k), &rows[k]);
      }
      InfluencesOf(elimination, inverse, point, rows, &influences);
      shift.setZero();
      for (size_t k = 0; k < rows.size(); ++k) {
        const auto& observation = observed_.observations[size_t(first) + k];
        const Eigen::Matrix<double, kNumMonomials, 1> monomials =
            std::sqrt(observation.weight) *
            Monomials(observed_.CameraOf(observation.image), observation.xy_px);
        for (int axis = 0; axis < 2; ++axis) {
          const auto influence = influences[k].col(axis);
          shift += influence * rows[k].residual(axis);
          auto& by_image = shifts->by_image[size_t(observation.image)];
          for (Eigen::Index i = 0; i < size; ++i) {
            by_image.col(begin + i).segment<kNumMonomials>(
                axis * kNumMonomials) += influence(i) * monomials;
          }
        }
      }
      shifts->sandwich.segment(begin, size) += shift.cwiseAbs2();
    }
  }

  // Threads share the free columns: each sum is formed by one of them.
  Shifts ShiftsOf(const Elimination& elimination,
                  const Eigen::MatrixXd& inverse) const {
    const Eigen::Index count = inverse.cols();
    Shifts shifts;
    shifts.sandwich = Eigen::VectorXd::Zero(count);
    shifts.by_image.resize(unknowns_.image_ids.size());
    for (auto& shift : shifts.by_image) shift.setZero(2 * kNumMonomials, count);
    const Eigen::MatrixXd transposed = inverse.transpose();
    const auto num_ranges = std::min<Eigen::Index>(num_threads_, count);
    ParallelFor(size_t(num_ranges), num_threads_, [&](size_t i) {
      const Eigen::Index begin = count * Eigen::Index(i) / num_ranges;
      const Eigen::Index end = count * (Eigen::Index(i) + 1) / num_ranges;
      FindShifts(elimination, transposed, begin, end - begin, &shifts);
    });
    return shifts;
  }

  // Covariances of the free columns, see EstimateIntrinsicsPosterior.
  struct Covariances {
    Eigen::MatrixXd of_keypoints;
    Eigen::MatrixXd of_all;
  };
  Covariances RealisticCovariances(const Elimination& elimination,
                                   const Eigen::MatrixXd& inverse,
                                   Eigen::MatrixXd covariance) const {
    const Shifts shifts = ShiftsOf(elimination, inverse);
    const Eigen::VectorXd factors =
        (shifts.sandwich.array() / covariance.diagonal().array())
            .max(1.0)
            .sqrt();
    covariance = factors.asDiagonal() * covariance * factors.asDiagonal();
    const Eigen::MatrixXd of_keypoints = covariance;

    std::map<uint32_t, Eigen::MatrixXd> common_shifts;
    for (size_t i = 0; i < shifts.by_image.size(); ++i) {
      const Eigen::MatrixXd scaled = kSmoothErrorRatio *
                                     LargerSide(observed_.CameraOf(int(i))) *
                                     shifts.by_image[i];
      covariance.noalias() += scaled.transpose() * scaled;
      Eigen::MatrixXd& common = common_shifts[unknowns_.BlockOf(
          model_.Image(unknowns_.image_ids[i]))];
      if (common.size() == 0) common.setZero(scaled.rows(), scaled.cols());
      common += scaled;
    }
    for (const auto& [block_id, shift] : common_shifts) {
      covariance.noalias() += shift.transpose() * shift;
    }
    return {of_keypoints, covariance};
  }

  const int num_threads_;
  const colmap::Reconstruction& model_;
  const PosteriorColumns unknowns_;
  const PosteriorObservations observed_;
};

}  // namespace

std::optional<IntrinsicsPosterior> EstimateIntrinsicsPosterior(
    const BundleAdjustmentOptions& options,
    int num_threads,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model,
    IntrinsicsBlocks blocks,
    size_t max_num_images) {
  if (model.NumPoints3D() == 0) return std::nullopt;
  return PosteriorProblem(
             options, num_threads, beliefs, model, blocks, max_num_images)
      .Solve();
}

}  // namespace dgsfm
