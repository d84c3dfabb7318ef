#include "estimators/two_view_cost.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <Eigen/Cholesky>

namespace dgsfm {
namespace {

// Matches between two looks at the cost bound.
constexpr int kScoreBlock = 16;

template <typename IsInlier>
TwoViewScore ScoreMatches(const TwoViewData& data,
                          const Eigen::Matrix3d& F,
                          double max_error_px,
                          double max_cost,
                          const IsInlier& is_inlier) {
  const double max_sq_error = max_error_px * max_error_px;
  TwoViewScore score;
  score.cost = 0;
  for (int i = 0; i < data.Size();) {
    const int end = std::min(i + kScoreBlock, data.Size());
    for (; i < end; ++i) {
      const double error = SampsonError(F, data.points1[i], data.points2[i]);
      const double sq_error = error * error;
      if (sq_error < max_sq_error &&
          is_inlier(data.points1[i], data.points2[i])) {
        score.cost += sq_error;
        ++score.num_inliers;
      } else {
        score.cost += max_sq_error;
      }
    }
    if (score.cost > max_cost) return {};
  }
  return score;
}

struct NormalEquations {
  TwoViewMatrix matrix = TwoViewMatrix::Zero();
  TwoViewStep gradient = TwoViewStep::Zero();
};

// Turns a transfer into the whitened residual (L^-1 r for L L^T = covariance).
class Whitening {
 public:
  Whitening() = default;
  // `epipolar_direction` of the line in image 2, not normalised.
  Whitening(const Transfer& transfer,
            double focal,
            const Eigen::Vector2d& epipolar_direction,
            double stddev_px,
            double log_depth_stddev) {
    const double inverse_z = 1 / transfer.point.z();
    const double log_z_slope = transfer.ray.z() * inverse_z;
    const Eigen::Vector2d shift =
        focal * inverse_z *
        (transfer.ray.head<2>() - transfer.point.head<2>() * log_z_slope);
    const double length = epipolar_direction.norm();
    // Without translation there is no line and every direction is as good.
    direction_ = length > 0 ? Eigen::Vector2d(epipolar_direction / length)
                            : Eigen::Vector2d::UnitX();
    const double shift_stddev = direction_.dot(shift) * log_depth_stddev;
    const double slope_stddev = log_z_slope * log_depth_stddev;
    const double l11 =
        std::sqrt(2 * stddev_px * stddev_px + shift_stddev * shift_stddev);
    const double l21 = shift_stddev * slope_stddev / l11;
    const double l22 =
        std::sqrt(std::max(slope_stddev * slope_stddev - l21 * l21, 0.0) +
                  log_depth_stddev * log_depth_stddev);
    w11_ = 1 / l11;
    w22_ = 1 / l22;
    w21_ = -l21 * w11_ * w22_;
  }

  Eigen::Vector2d operator()(const Transfer& transfer) const {
    const double along = direction_.dot(transfer.error_px);
    return {w11_ * along, w21_ * along + w22_ * transfer.log_depth_ratio};
  }

  Eigen::Matrix<double, 2, kNumTwoViewParams> operator()(
      const TransferJacobian& jacobian) const {
    Eigen::Matrix<double, 2, kNumTwoViewParams> whitened;
    whitened.row(0) = w11_ * direction_.transpose() * jacobian.topRows<2>();
    whitened.row(1) = (w21_ / w11_) * whitened.row(0) + w22_ * jacobian.row(2);
    return whitened;
  }

 private:
  Eigen::Vector2d direction_;
  double w11_, w21_, w22_;
};

class CostFunction {
 public:
  CostFunction(const TwoViewData& data, const TwoViewCostOptions& options)
      : data_(data),
        options_(options),
        size_(std::min(data.Size(), options.max_num_matches)),
        inverse_stddev_(1 / options.stddev_px),
        max_sq_epipolar_(
            Square(options.max_epipolar_error_px * inverse_stddev_)),
        max_sq_depth_(Square(options.max_depth_residual)),
        reprojection_weight_(options.max_epipolar_error_px * inverse_stddev_ /
                             options.max_reprojection_error_px) {}

  // Sets the model of the whitening.
  void WhitenAt(const TwoViewModel& model) {
    if (options_.depth_term != DepthTerm::WHITENED) return;
    whitenings_.assign(size_, std::nullopt);
    const Eigen::Matrix3d F = model.FundamentalMatrix();
    for (int i = 0; i < size_; ++i) {
      Transfer transfer;
      if (!data_.HasDepths(i) || !Forward(model, i, &transfer, nullptr)) {
        continue;
      }
      const Eigen::Vector3d line = F * data_.points1[i].homogeneous();
      whitenings_[i].emplace(transfer,
                             model.focal2,
                             Eigen::Vector2d(line.y(), -line.x()),
                             options_.stddev_px,
                             options_.log_depth_stddev);
    }
  }

  // Cost at `model`; adds to `normal` if there is one.
  TwoViewCost Evaluate(const TwoViewModel& model,
                       NormalEquations* normal) const {
    TwoViewCost cost;
    AddEpipolar(model, &cost, normal);
    if (options_.depth_term != DepthTerm::NONE) {
      AddDepth(model, &cost, normal);
    }
    AddPrior(model, &cost, normal);
    return cost;
  }

 private:
  static double Square(double x) { return x * x; }

  // Robustified square; `weight` is its derivative.
  double Loss(double sq_error, double max_sq_error, double* weight) const {
    const double bounded = std::min(sq_error, max_sq_error);
    const bool is_inlier = sq_error < max_sq_error;
    if (!options_.cauchy) {
      *weight = is_inlier ? 1 : 0;
      return bounded;
    }
    *weight = is_inlier ? 1 / (1 + sq_error / max_sq_error) : 0;
    return max_sq_error * std::log1p(bounded / max_sq_error);
  }

  void AddEpipolar(const TwoViewModel& model,
                   TwoViewCost* cost,
                   NormalEquations* normal) const {
    const Eigen::Matrix3d F = model.FundamentalMatrix();
    // Summed over the entries of F, then chained to the parameters once.
    Eigen::Matrix<double, 9, 9> matrix = Eigen::Matrix<double, 9, 9>::Zero();
    Eigen::Matrix<double, 9, 1> gradient = Eigen::Matrix<double, 9, 1>::Zero();
    for (int i = 0; i < size_; ++i) {
      const double error =
          SampsonError(F, data_.points1[i], data_.points2[i]) * inverse_stddev_;
      double weight;
      cost->epipolar += Loss(error * error, max_sq_epipolar_, &weight);
      if (!normal || weight == 0) continue;
      Eigen::Matrix3d J;
      SampsonError(F, data_.points1[i], data_.points2[i], &J);
      const Eigen::Map<const Eigen::Matrix<double, 9, 1>> j(J.data());
      const Eigen::Matrix<double, 9, 1> weighted =
          weight * Square(inverse_stddev_) * j;
      matrix += weighted.lazyProduct(j.transpose());
      gradient += (weight * inverse_stddev_ * error) * j;
    }
    if (normal) {
      const auto chain = FundamentalMatrixJacobian(model);
      normal->matrix +=
          chain.transpose().lazyProduct(matrix.lazyProduct(chain).eval());
      normal->gradient += chain.transpose() * gradient;
    }
  }

  void AddDepth(const TwoViewModel& model,
                TwoViewCost* cost,
                NormalEquations* normal) const {
    for (int i = 0; i < size_; ++i) {
      if (!data_.HasDepths(i)) continue;
      if (options_.depth_term == DepthTerm::WHITENED) {
        AddWhitened(i, model, cost, normal);
      } else {
        AddReprojection(i, TransferForward, model, cost, normal);
        AddReprojection(i, TransferBackward, model, cost, normal);
      }
    }
  }

  void AddWhitened(int i,
                   const TwoViewModel& model,
                   TwoViewCost* cost,
                   NormalEquations* normal) const {
    Transfer transfer;
    TransferJacobian jacobian;
    double weight;
    if (!whitenings_[i] || !Forward(model, i, &transfer, nullptr)) {
      cost->depth += Loss(2 * max_sq_depth_, max_sq_depth_, &weight);
      return;
    }
    const Eigen::Vector2d residual = (*whitenings_[i])(transfer);
    cost->depth += Loss(residual.squaredNorm(), max_sq_depth_, &weight);
    if (weight == 0) return;
    ++cost->num_depth_inliers;
    if (!normal) return;
    Forward(model, i, &transfer, &jacobian);
    Add(residual, (*whitenings_[i])(jacobian), weight, normal);
  }

  template <typename TransferFunction>
  void AddReprojection(int i,
                       const TransferFunction& transfer_match,
                       const TwoViewModel& model,
                       TwoViewCost* cost,
                       NormalEquations* normal) const {
    Transfer transfer;
    TransferJacobian jacobian;
    double weight;
    if (!transfer_match(model,
                        data_.points1[i],
                        data_.depths1[i],
                        data_.points2[i],
                        data_.depths2[i],
                        &transfer,
                        normal ? &jacobian : nullptr)) {
      cost->depth += Loss(2 * max_sq_epipolar_, max_sq_epipolar_, &weight);
      return;
    }
    const Eigen::Vector2d residual = reprojection_weight_ * transfer.error_px;
    cost->depth += Loss(residual.squaredNorm(), max_sq_epipolar_, &weight);
    if (weight == 0) return;
    ++cost->num_depth_inliers;
    if (!normal) return;
    Add(residual, reprojection_weight_ * jacobian.topRows<2>(), weight, normal);
  }

  bool Forward(const TwoViewModel& model,
               int i,
               Transfer* transfer,
               TransferJacobian* jacobian) const {
    return TransferForward(model,
                           data_.points1[i],
                           data_.depths1[i],
                           data_.points2[i],
                           data_.depths2[i],
                           transfer,
                           jacobian);
  }

  static void Add(const Eigen::Vector2d& residual,
                  const Eigen::Matrix<double, 2, kNumTwoViewParams>& J,
                  double weight,
                  NormalEquations* normal) {
    const Eigen::Matrix<double, 2, kNumTwoViewParams> weighted = weight * J;
    normal->matrix += weighted.transpose().lazyProduct(J);
    normal->gradient += weighted.transpose().lazyProduct(residual);
  }

  void AddPrior(const TwoViewModel& model,
                TwoViewCost* cost,
                NormalEquations* normal) const {
    if (options_.log_focal_prior_stddev == 0) return;
    const double weight = 1 / Square(options_.log_focal_prior_stddev);
    const double residuals[2] = {
        std::log(model.focal1 / options_.focal_prior1_px),
        std::log(model.focal2 / options_.focal_prior2_px)};
    for (int k = 0; k < 2; ++k) {
      cost->prior += weight * Square(residuals[k]);
      if (!normal) continue;
      normal->matrix(kLogFocal1Param + k, kLogFocal1Param + k) += weight;
      normal->gradient(kLogFocal1Param + k) += weight * residuals[k];
    }
  }

  const TwoViewData& data_;
  const TwoViewCostOptions& options_;
  const int size_;
  const double inverse_stddev_;
  const double max_sq_epipolar_;
  const double max_sq_depth_;
  const double reprojection_weight_;
  std::vector<std::optional<Whitening>> whitenings_;
};

using Basis = Eigen::Matrix<double,
                            kNumTwoViewParams,
                            Eigen::Dynamic,
                            Eigen::ColMajor,
                            kNumTwoViewParams,
                            kNumTwoViewParams>;

using ReducedMatrix = Eigen::Matrix<double,
                                    Eigen::Dynamic,
                                    Eigen::Dynamic,
                                    Eigen::ColMajor,
                                    kNumTwoViewParams,
                                    kNumTwoViewParams>;
using ReducedVector = Eigen::
    Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kNumTwoViewParams, 1>;

// The unknown parameters: columns span the allowed steps.
Basis UnknownParameters(FocalCase focal_case,
                        DepthTerm depth_term,
                        const TwoViewModel& model) {
  Basis basis = Basis::Zero(kNumTwoViewParams, kNumTwoViewParams);
  basis.topLeftCorner<3, 3>().setIdentity();
  int num_columns = 3;
  if (depth_term == DepthTerm::NONE) {
    // Two directions across the translation keep its length to first order.
    const Eigen::Vector3d direction = model.translation.normalized();
    const Eigen::Vector3d across = direction.unitOrthogonal();
    basis.block<3, 1>(3, num_columns++) = across;
    basis.block<3, 1>(3, num_columns++) = direction.cross(across);
  } else {
    basis.block<3, 3>(3, num_columns).setIdentity();
    num_columns += 3;
    basis(kLogScaleParam, num_columns++) = 1;
  }
  const bool unknown1 =
      focal_case == FocalCase::TWO || focal_case == FocalCase::ONE_SIDED2;
  const bool unknown2 =
      focal_case == FocalCase::TWO || focal_case == FocalCase::ONE_SIDED1;
  if (focal_case == FocalCase::SHARED) {
    basis(kLogFocal1Param, num_columns) = 1;
    basis(kLogFocal2Param, num_columns++) = 1;
  }
  if (unknown1) basis(kLogFocal1Param, num_columns++) = 1;
  if (unknown2) basis(kLogFocal2Param, num_columns++) = 1;
  return basis.leftCols(num_columns);
}

}  // namespace

Cheirality::Cheirality(const TwoViewModel& model, double max_error_px)
    : ray1_in_cam2_(
          model.rotation *
          Eigen::Vector3d(1 / model.focal1, 1 / model.focal1, 1).asDiagonal()),
      translation_(model.translation),
      inverse_focal2_(1 / model.focal2) {
  // Both points may be off: the angle of the rays is noise below this.
  const double sine = 2 * max_error_px / std::min(model.focal1, model.focal2);
  max_sq_sine_ = sine * sine;
}

bool Cheirality::operator()(const Eigen::Vector2d& x1,
                            const Eigen::Vector2d& x2) const {
  const Eigen::Vector3d p = ray1_in_cam2_ * x1.homogeneous();
  const Eigen::Vector3d q(
      x2.x() * inverse_focal2_, x2.y() * inverse_focal2_, 1);
  const double pp = p.squaredNorm();
  const double qq = q.squaredNorm();
  const double pq = p.dot(q);
  const double pt = p.dot(translation_);
  const double qt = q.dot(translation_);
  // z1 p + t = z2 q in the least-squares sense, times pp qq - pq^2 >= 0.
  if (pq * qt > qq * pt && pp * qt > pq * pt) return true;
  return pq > 0 && pp * qq - pq * pq < max_sq_sine_ * pp * qq;
}

TwoViewScore ScoreModel(const TwoViewData& data,
                        const TwoViewModel& model,
                        double max_error_px,
                        double max_cost) {
  return ScoreMatches(data,
                      model.FundamentalMatrix(),
                      max_error_px,
                      max_cost,
                      Cheirality(model, max_error_px));
}

TwoViewScore ScoreFundamentalMatrix(const TwoViewData& data,
                                    const Eigen::Matrix3d& F,
                                    double max_error_px,
                                    double max_cost) {
  return ScoreMatches(
      data,
      F,
      max_error_px,
      max_cost,
      [](const Eigen::Vector2d&, const Eigen::Vector2d&) { return true; });
}

TwoViewCost EvaluateCost(const TwoViewData& data,
                         const TwoViewModel& model,
                         const TwoViewCostOptions& options) {
  CostFunction function(data, options);
  function.WhitenAt(model);
  return function.Evaluate(model, nullptr);
}

TwoViewCost RefineModel(const TwoViewData& data,
                        FocalCase focal_case,
                        const TwoViewCostOptions& options,
                        int max_num_iterations,
                        TwoViewModel* model) {
  // Bound of a step in log scale and log focal lengths: beyond it the
  // linearisation says nothing.
  constexpr double kMaxLogStep = 0.7;
  // Steps that lower nothing are the end, not a matter of damping.
  constexpr int kMaxNumTries = 6;
  CostFunction function(data, options);
  TwoViewCost cost;
  double damping = 1e-3;
  for (int iteration = 0; iteration < max_num_iterations; ++iteration) {
    NormalEquations normal;
    function.WhitenAt(*model);
    cost = function.Evaluate(*model, &normal);
    const Basis basis =
        UnknownParameters(focal_case, options.depth_term, *model);
    const ReducedMatrix matrix =
        basis.transpose().lazyProduct(normal.matrix.lazyProduct(basis).eval());
    const ReducedVector gradient =
        basis.transpose().lazyProduct(normal.gradient);
    const double min_decrease = options.min_relative_decrease * cost.Total();
    bool improved = false;
    for (int k = 0; k < kMaxNumTries && !improved; ++k) {
      ReducedMatrix damped = matrix;
      damped.diagonal() *= 1 + damping;
      damped.diagonal().array() += 1e-12;
      const ReducedVector reduced_step = -damped.ldlt().solve(gradient);
      if (!reduced_step.allFinite()) return cost;
      // What the linearisation promises is twice the decrease at most.
      if (-gradient.dot(reduced_step) < min_decrease) return cost;
      TwoViewStep step = basis.lazyProduct(reduced_step);
      step.tail<3>() =
          step.tail<3>().cwiseMax(-kMaxLogStep).cwiseMin(kMaxLogStep);
      TwoViewModel moved = Retract(*model, step);
      if (options.depth_term == DepthTerm::NONE) {
        moved.translation.normalize();
      }
      const TwoViewCost moved_cost = function.Evaluate(moved, nullptr);
      if (moved.IsFinite() && moved_cost.Total() < cost.Total()) {
        const double decrease = cost.Total() - moved_cost.Total();
        *model = moved;
        cost = moved_cost;
        damping = std::max(damping * 0.1, 1e-10);
        improved = true;
        if (decrease < min_decrease) return cost;
      } else {
        damping *= 10;
      }
    }
    if (!improved) break;
  }
  return cost;
}

TwoViewMatrix EstimateCovariance(const TwoViewData& data,
                                 FocalCase focal_case,
                                 const TwoViewCostOptions& options,
                                 const TwoViewModel& model) {
  TwoViewCostOptions without_prior = options;
  without_prior.log_focal_prior_stddev = 0;
  NormalEquations normal;
  CostFunction function(data, without_prior);
  function.WhitenAt(model);
  function.Evaluate(model, &normal);
  const Basis basis = UnknownParameters(focal_case, options.depth_term, model);
  // A little information about everything keeps the inverse finite.
  const auto information =
      (basis.transpose() * normal.matrix * basis +
       1e-9 * Eigen::MatrixXd::Identity(basis.cols(), basis.cols()))
          .eval();
  return basis *
         information.ldlt().solve(
             Eigen::MatrixXd::Identity(basis.cols(), basis.cols())) *
         basis.transpose();
}

}  // namespace dgsfm
