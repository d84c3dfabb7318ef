#include "estimators/two_view/two_view_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dgsfm {
namespace {

double Square(double x) { return x * x; }

// The lower triangle of the first rows and columns of matrix += left right^T.
// Unrolled over columns: it takes most of the time of an iteration.
template <int kColumn = 0, int kSize, typename Matrix>
void AddLowerProduct(const Eigen::Matrix<double, kSize, 1>& left,
                     const Eigen::Matrix<double, kSize, 1>& right,
                     Matrix* matrix) {
  if constexpr (kColumn < kSize) {
    matrix->col(kColumn).template segment<kSize - kColumn>(kColumn) +=
        right(kColumn) * left.template tail<kSize - kColumn>();
    AddLowerProduct<kColumn + 1>(left, right, matrix);
  }
}

// Row of the Jacobian by the first parameters.
template <int kSize>
void AddRow(const Eigen::Matrix<double, kSize, 1>& row,
            double residual,
            double weight,
            NormalEquations* normal) {
  const Eigen::Matrix<double, kSize, 1> weighted = weight * row;
  AddLowerProduct(row, weighted, &normal->matrix);
  normal->gradient.template head<kSize>() += residual * weighted;
}

// Sum of robustified squares. Squares are normalised by the truncation; sums of
// logarithms are logarithms of products, which need one logarithm for many.
class LossSum {
 public:
  LossSum(TwoViewLoss loss, double max_sq_error)
      : loss_(loss), max_sq_error_(max_sq_error) {}

  // Returns the derivative of the robustified square.
  double Add(double sq_error) {
    const double ratio = sq_error / max_sq_error_;
    const bool is_inlier = ratio < 1 || loss_ == TwoViewLoss::CAUCHY;
    if (loss_ == TwoViewLoss::TRUNCATED_SQUARES) {
      total_ += is_inlier ? sq_error : max_sq_error_;
      return is_inlier ? 1 : 0;
    }
    product_ *= is_inlier ? 1 + ratio : 2;
    if (product_ > kMaxProduct) {
      total_ += max_sq_error_ * std::log(product_);
      product_ = 1;
    }
    return is_inlier ? 1 / (1 + ratio) : 0;
  }

  double Total() const { return total_ + max_sq_error_ * std::log(product_); }

 private:
  // Far enough from the largest number for one more factor.
  static constexpr double kMaxProduct = 1e100;

  const TwoViewLoss loss_;
  const double max_sq_error_;
  double total_ = 0;
  double product_ = 1;
};

}  // namespace

TwoViewCostFunction::TwoViewCostFunction(const TwoViewData& data,
                                         const TwoViewCostOptions& options)
    : data_(data),
      options_(options),
      inverse_stddev_(1 / options.stddev_px),
      max_sq_epipolar_(Square(options.max_epipolar_error_px * inverse_stddev_)),
      max_sq_depth_(Square(options.max_depth_residual)),
      reprojection_weight_(options.max_epipolar_error_px * inverse_stddev_ /
                           options.max_reprojection_error_px) {
  if (!HasFields()) return;
  for (const TwoViewMatch& match : data) {
    basis1_.push_back(
        EvaluateDepthFieldBasis(match.x1 / options.depth_field_unit1_px));
    basis2_.push_back(
        EvaluateDepthFieldBasis(match.x2 / options.depth_field_unit2_px));
  }
}

TwoViewCost TwoViewCostFunction::Linearize(const TwoViewModel& model,
                                           const DepthFields& fields,
                                           NormalEquations* normal) {
  normal->matrix.setZero();
  normal->gradient.setZero();
  const TwoViewCost cost = Sum(model, fields, normal);
  normal->matrix.triangularView<Eigen::StrictlyUpper>() =
      normal->matrix.transpose();
  return cost;
}

TwoViewCost TwoViewCostFunction::Evaluate(const TwoViewModel& model,
                                          const DepthFields& fields) {
  return Sum(model, fields, nullptr);
}

TwoViewCost TwoViewCostFunction::EvaluateDepth(const TwoViewModel& model) {
  TwoViewCost cost;
  AddWhitened(model, DepthFields::Zero(), /*whiten=*/true, &cost, nullptr);
  return cost;
}

TwoViewCost TwoViewCostFunction::Sum(const TwoViewModel& model,
                                     const DepthFields& fields,
                                     NormalEquations* normal) {
  TwoViewCost cost;
  AddEpipolar(model, &cost, normal);
  if (options_.depth_term == DepthTerm::WHITENED) {
    // Costs compare only under one whitening: that of the linearisation.
    AddWhitened(model, fields, /*whiten=*/normal != nullptr, &cost, normal);
  } else if (options_.depth_term == DepthTerm::REPROJECTION) {
    AddReprojection(model, &cost, normal);
  }
  AddPriors(model, fields, &cost, normal);
  return cost;
}

Eigen::Vector2d TwoViewCostFunction::Whitening::operator()(
    const Transfer& transfer) const {
  const double along = direction.dot(transfer.error_px);
  return {w11 * along, w21 * along + w22 * transfer.log_depth_ratio};
}

TwoViewCostFunction::Whitening TwoViewCostFunction::WhitenAt(
    const TwoViewModel& model,
    const Eigen::Matrix3d& F,
    const Transfer& transfer,
    const TwoViewMatch& match) const {
  // How the transferred point and the log of its depth move with the log of the
  // depth in map 1.
  const double inverse_z = 1 / transfer.point.z();
  const double log_z_slope = transfer.ray.z() * inverse_z;
  const Eigen::Vector2d shift =
      model.focal2 * inverse_z *
      (transfer.ray.head<2>() - transfer.point.head<2>() * log_z_slope);
  const Eigen::Vector2d line =
      F.topLeftCorner<2, 2>() * match.x1 + F.block<2, 1>(0, 2);
  const double length = line.norm();
  Whitening whitening;
  // Without translation there is no line and every direction is as good.
  whitening.direction =
      length > 0 ? Eigen::Vector2d(line.y() / length, -line.x() / length)
                 : Eigen::Vector2d::UnitX();
  whitening.shift = whitening.direction.dot(shift);
  whitening.slope = log_z_slope;
  const double shift_stddev = whitening.shift * options_.log_depth_stddev;
  const double slope_stddev = log_z_slope * options_.log_depth_stddev;
  // Cholesky factor of the 2 x 2 covariance, whose second variance is at least
  // that of map 2: rounding must not make it less.
  const double l11 = std::sqrt(match.Variance() * Square(options_.stddev_px) +
                               Square(shift_stddev));
  const double l21 = shift_stddev * slope_stddev / l11;
  const double l22 =
      std::sqrt(std::max(Square(slope_stddev) - Square(l21), 0.0) +
                Square(options_.log_depth_stddev));
  whitening.w11 = 1 / l11;
  whitening.w22 = 1 / l22;
  whitening.w21 = -l21 * whitening.w11 * whitening.w22;
  return whitening;
}

void TwoViewCostFunction::AddEpipolar(const TwoViewModel& model,
                                      TwoViewCost* cost,
                                      NormalEquations* normal) const {
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  // Summed over the entries of F, then chained to the parameters once.
  Eigen::Matrix<double, 9, 9> matrix = Eigen::Matrix<double, 9, 9>::Zero();
  Eigen::Matrix<double, 9, 1> gradient = Eigen::Matrix<double, 9, 1>::Zero();
  Eigen::Matrix<double, 9, 1> row;
  Eigen::Matrix3d slope;
  const double sq_inverse_stddev = Square(inverse_stddev_);
  LossSum sum(options_.loss, max_sq_epipolar_);
  for (const TwoViewMatch& match : data_) {
    const double error = match.Sampson(F, normal ? &slope : nullptr);
    double weight = sum.Add(Square(error) * sq_inverse_stddev);
    if (!normal || weight == 0) continue;
    weight *= sq_inverse_stddev;
    row = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(slope.data());
    AddLowerProduct(row, Eigen::Matrix<double, 9, 1>(weight * row), &matrix);
    gradient += (weight * error) * row;
  }
  cost->epipolar += sum.Total();
  if (!normal) return;
  const auto chain = FundamentalMatrixJacobian(model);
  matrix.triangularView<Eigen::StrictlyUpper>() = matrix.transpose();
  normal->matrix.topLeftCorner<kNumTwoViewParams, kNumTwoViewParams>() +=
      chain.transpose().lazyProduct(matrix.lazyProduct(chain).eval());
  normal->gradient.head<kNumTwoViewParams>() += chain.transpose() * gradient;
}

bool TwoViewCostFunction::Forward(const TwoViewModel& model,
                                  const DepthFields& fields,
                                  int i,
                                  Transfer* transfer) const {
  const TwoViewMatch& match = data_[i];
  if (!HasFields()) return match.Forward(model, transfer);
  return TransferMatch(
      model,
      match.x1,
      match.depth1 *
          std::exp(-basis1_[i].dot(fields.head<kNumDepthFieldTerms>())),
      match.x2,
      match.depth2 *
          std::exp(-basis2_[i].dot(fields.tail<kNumDepthFieldTerms>())),
      transfer);
}

void TwoViewCostFunction::AddWhitened(const TwoViewModel& model,
                                      const DepthFields& fields,
                                      bool whiten,
                                      TwoViewCost* cost,
                                      NormalEquations* normal) {
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  if (whiten) whitenings_.assign(data_.size(), Whitening());
  LossSum sum(options_.loss, max_sq_depth_);
  for (size_t i = 0; i < data_.size(); ++i) {
    if (!data_[i].HasDepths()) continue;
    Transfer transfer;
    const bool in_front = Forward(model, fields, i, &transfer);
    if (whiten && in_front) {
      whitenings_[i] = WhitenAt(model, F, transfer, data_[i]);
    }
    // Twice the truncation is an outlier under every loss.
    if (!in_front || whitenings_[i].w11 == 0) {
      sum.Add(2 * max_sq_depth_);
      continue;
    }
    const double weight = sum.Add(whitenings_[i](transfer).squaredNorm());
    if (weight == 0) continue;
    ++cost->num_depth_inliers;
    if (normal) AddWhitenedRows(i, model, transfer, weight, normal);
  }
  cost->depth += sum.Total();
}

void TwoViewCostFunction::AddWhitenedRows(int i,
                                          const TwoViewModel& model,
                                          const Transfer& transfer,
                                          double weight,
                                          NormalEquations* normal) const {
  const Whitening& whitening = whitenings_[i];
  const Eigen::Vector2d residual = whitening(transfer);
  const TwoViewStep row1 =
      TransferGradient(model, transfer, whitening.w11 * whitening.direction, 0);
  const TwoViewStep row2 = TransferGradient(
      model, transfer, whitening.w21 * whitening.direction, whitening.w22);
  if (!HasFields()) {
    AddRow(row1, residual(0), weight, normal);
    AddRow(row2, residual(1), weight, normal);
    return;
  }
  // The field of map 1 moves the transferred point, that of map 2 the depth it
  // is compared with.
  const double slope1 = -whitening.w11 * whitening.shift;
  const double slope2 =
      -(whitening.w21 * whitening.shift + whitening.w22 * whitening.slope);
  Eigen::Matrix<double, kNumCostParams, 1> row;
  row << row1, slope1 * basis1_[i], DepthFieldBasis::Zero();
  AddRow(row, residual(0), weight, normal);
  row << row2, slope2 * basis1_[i], whitening.w22 * basis2_[i];
  AddRow(row, residual(1), weight, normal);
}

void TwoViewCostFunction::AddReprojection(const TwoViewModel& model,
                                          TwoViewCost* cost,
                                          NormalEquations* normal) const {
  LossSum sum(options_.loss, max_sq_epipolar_);
  for (const bool forward : {true, false}) {
    const TwoViewModel from_to = forward ? model : model.Inverse();
    const TwoViewMatrix chain =
        forward ? TwoViewMatrix::Identity() : InverseJacobian(model);
    for (const TwoViewMatch& match : data_) {
      Transfer transfer;
      if (!match.HasDepths() ||
          !(forward ? match : match.Swapped()).Forward(from_to, &transfer)) {
        continue;
      }
      const Eigen::Vector2d residual = reprojection_weight_ * transfer.error_px;
      const double weight = sum.Add(residual.squaredNorm());
      if (weight == 0) continue;
      ++cost->num_depth_inliers;
      if (!normal) continue;
      for (int k = 0; k < 2; ++k) {
        const TwoViewStep row =
            chain.transpose() *
            TransferGradient(from_to,
                             transfer,
                             reprojection_weight_ * Eigen::Vector2d::Unit(k),
                             0);
        AddRow(row, residual(k), weight, normal);
      }
    }
  }
  cost->depth += sum.Total();
}

void TwoViewCostFunction::AddPriors(const TwoViewModel& model,
                                    const DepthFields& fields,
                                    TwoViewCost* cost,
                                    NormalEquations* normal) const {
  // Priors are not robust: they hold what the matches leave open, and matches
  // that determine a focal length outweigh them.
  const auto add = [&](const FocalPrior& prior, double focal, int param) {
    if (prior.log_stddev == 0) return;
    const double weight = 1 / Square(prior.log_stddev);
    const double residual = std::log(focal / prior.focal_px);
    cost->prior += weight * Square(residual);
    if (!normal) return;
    normal->matrix(param, param) += weight;
    normal->gradient(param) += weight * residual;
  };
  add(options_.focal_prior1, model.focal1, kLogFocal1Param);
  add(options_.focal_prior2, model.focal2, kLogFocal2Param);
  if (!HasFields()) return;
  const double field_weight = 1 / Square(options_.depth_field_stddev);
  cost->prior += field_weight * fields.squaredNorm();
  if (!normal) return;
  normal->matrix.diagonal().tail<2 * kNumDepthFieldTerms>().array() +=
      field_weight;
  normal->gradient.tail<2 * kNumDepthFieldTerms>() += field_weight * fields;
}

}  // namespace dgsfm
