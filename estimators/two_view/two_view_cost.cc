#include "estimators/two_view/two_view_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dgsfm {
namespace {

double Square(double x) { return x * x; }

// The lower triangle of matrix += left right^T, from a column on.
template <int kColumn = 0, int kSize>
void AddLowerProduct(const Eigen::Matrix<double, kSize, 1>& left,
                     const Eigen::Matrix<double, kSize, 1>& right,
                     Eigen::Matrix<double, kSize, kSize>* matrix) {
  if constexpr (kColumn < kSize) {
    matrix->col(kColumn).template tail<kSize - kColumn>() +=
        right(kColumn) * left.template tail<kSize - kColumn>();
    AddLowerProduct<kColumn + 1>(left, right, matrix);
  }
}

void AddRow(const TwoViewStep& row,
            double residual,
            double weight,
            NormalEquations* normal) {
  AddLowerProduct(row, TwoViewStep(weight * row), &normal->matrix);
  normal->gradient += (weight * residual) * row;
}

// Sum of robustified squares.
class LossSum {
 public:
  LossSum(TwoViewLoss loss, double max_sq_error)
      : loss_(loss), max_sq_error_(max_sq_error) {}

  // Returns the derivative of the robustified square.
  double Add(double sq_error) {
    if (loss_ == TwoViewLoss::CAUCHY) {
      const double ratio = sq_error / max_sq_error_;
      sum_ += max_sq_error_ * std::log1p(ratio);
      return 1 / (1 + ratio);
    }
    const bool is_inlier = sq_error < max_sq_error_;
    if (loss_ == TwoViewLoss::TRUNCATED_SQUARES) {
      sum_ += is_inlier ? sq_error : max_sq_error_;
      return is_inlier ? 1 : 0;
    }
    // Factors are at most 2, so that one logarithm serves many.
    const double factor = is_inlier ? 1 + sq_error / max_sq_error_ : 2;
    product_ *= factor;
    if (product_ > std::numeric_limits<double>::max() / 2) Flush();
    return is_inlier ? 1 / factor : 0;
  }

  double Total() {
    if (loss_ == TwoViewLoss::TRUNCATED_CAUCHY) Flush();
    return sum_;
  }

 private:
  void Flush() {
    sum_ += max_sq_error_ * std::log(product_);
    product_ = 1;
  }

  const TwoViewLoss loss_;
  const double max_sq_error_;
  double sum_ = 0;
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
  for (int i = 0; i < data.Size(); ++i) {
    basis1_.push_back(EvaluateDepthFieldBasis(data.points1[i] /
                                              options.depth_field_unit1_px));
    basis2_.push_back(EvaluateDepthFieldBasis(data.points2[i] /
                                              options.depth_field_unit2_px));
  }
}

TwoViewCost TwoViewCostFunction::Linearize(const TwoViewModel& model,
                                           const DepthFields& fields,
                                           NormalEquations* normal) {
  normal->matrix.setZero();
  normal->gradient.setZero();
  if (HasFields()) {
    normal->field_matrix.setZero();
    normal->field_gradient.setZero();
    normal->cross.setZero();
  }
  TwoViewCost cost;
  AddEpipolar(model, &cost, normal);
  if (options_.depth_term == DepthTerm::WHITENED) {
    LinearizeWhitened(model, fields, &cost, normal);
  } else if (options_.depth_term == DepthTerm::REPROJECTION) {
    AddReprojection(TransferDirection::FORWARD, model, &cost, normal);
    AddReprojection(TransferDirection::BACKWARD, model, &cost, normal);
  }
  AddPriors(model, fields, &cost, normal);
  normal->matrix.triangularView<Eigen::StrictlyUpper>() =
      normal->matrix.transpose();
  return cost;
}

TwoViewCost TwoViewCostFunction::Evaluate(const TwoViewModel& model,
                                          const DepthFields& fields) const {
  TwoViewCost cost;
  AddEpipolar(model, &cost, nullptr);
  if (options_.depth_term == DepthTerm::WHITENED) {
    AddWhitened(model, fields, &cost);
  } else if (options_.depth_term == DepthTerm::REPROJECTION) {
    AddReprojection(TransferDirection::FORWARD, model, &cost, nullptr);
    AddReprojection(TransferDirection::BACKWARD, model, &cost, nullptr);
  }
  AddPriors(model, fields, &cost, nullptr);
  return cost;
}

TwoViewCost TwoViewCostFunction::EvaluateDepth(const TwoViewModel& model) {
  TwoViewCost cost;
  LinearizeWhitened(model, DepthFields::Zero(), &cost, nullptr);
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
    int i) const {
  const double inverse_z = 1 / transfer.point.z();
  const double log_z_slope = transfer.ray.z() * inverse_z;
  const Eigen::Vector2d shift =
      model.focal2 * inverse_z *
      (transfer.ray.head<2>() - transfer.point.head<2>() * log_z_slope);
  const Eigen::Vector2d line =
      F.topLeftCorner<2, 2>() * data_.points1[i] + F.block<2, 1>(0, 2);
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
  const double l11 = std::sqrt(data_.Variance(i) * Square(options_.stddev_px) +
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
  for (int i = 0; i < data_.Size(); ++i) {
    const double error = data_.Sampson(F, i, normal ? &slope : nullptr);
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
  normal->matrix +=
      chain.transpose().lazyProduct(matrix.lazyProduct(chain).eval());
  normal->gradient += chain.transpose() * gradient;
}

bool TwoViewCostFunction::Forward(const TwoViewModel& model,
                                  const DepthFields& fields,
                                  int i,
                                  Transfer* transfer) const {
  if (!HasFields()) return data_.Forward(model, i, transfer);
  return TransferMatch(
      TransferDirection::FORWARD,
      model,
      data_.points1[i],
      data_.depths1[i] *
          std::exp(-basis1_[i].dot(fields.head<kNumDepthFieldTerms>())),
      data_.points2[i],
      data_.depths2[i] *
          std::exp(-basis2_[i].dot(fields.tail<kNumDepthFieldTerms>())),
      transfer);
}

void TwoViewCostFunction::AddWhitened(const TwoViewModel& model,
                                      const DepthFields& fields,
                                      TwoViewCost* cost) const {
  LossSum sum(options_.loss, max_sq_depth_);
  for (int i = 0; i < data_.Size(); ++i) {
    if (!data_.HasDepths(i)) continue;
    Transfer transfer;
    if (whitenings_[i].w11 == 0 || !Forward(model, fields, i, &transfer)) {
      sum.Add(2 * max_sq_depth_);
      continue;
    }
    const double weight = sum.Add(whitenings_[i](transfer).squaredNorm());
    cost->num_depth_inliers += weight != 0;
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
  const TwoViewStep row1 = TransferGradient(TransferDirection::FORWARD,
                                            model,
                                            transfer,
                                            whitening.w11 * whitening.direction,
                                            0);
  const TwoViewStep row2 = TransferGradient(TransferDirection::FORWARD,
                                            model,
                                            transfer,
                                            whitening.w21 * whitening.direction,
                                            whitening.w22);
  AddRow(row1, residual(0), weight, normal);
  AddRow(row2, residual(1), weight, normal);
  if (!HasFields()) return;
  // The rows by the fields are (slope1 basis1, 0) and (slope2 basis1,
  // w22 basis2).
  const DepthFieldBasis& basis1 = basis1_[i];
  const DepthFieldBasis& basis2 = basis2_[i];
  const double slope1 = -whitening.w11 * whitening.shift;
  const double slope2 =
      -(whitening.w21 * whitening.shift + whitening.w22 * whitening.slope);
  const DepthFieldBasis square1 =
      (weight * (Square(slope1) + Square(slope2))) * basis1;
  const DepthFieldBasis mixed = (weight * slope2 * whitening.w22) * basis2;
  const DepthFieldBasis square2 = (weight * Square(whitening.w22)) * basis2;
  const TwoViewStep cross1 = weight * (slope1 * row1 + slope2 * row2);
  const TwoViewStep cross2 = (weight * whitening.w22) * row2;
  for (int k = 0; k < kNumDepthFieldTerms; ++k) {
    normal->field_matrix.col(k).head<kNumDepthFieldTerms>() +=
        basis1(k) * square1;
    normal->field_matrix.col(k).tail<kNumDepthFieldTerms>() +=
        basis1(k) * mixed;
    normal->field_matrix.col(kNumDepthFieldTerms + k)
        .tail<kNumDepthFieldTerms>() += basis2(k) * square2;
    normal->cross.col(k) += basis1(k) * cross1;
    normal->cross.col(kNumDepthFieldTerms + k) += basis2(k) * cross2;
  }
  normal->field_gradient.head<kNumDepthFieldTerms>() +=
      (weight * (slope1 * residual(0) + slope2 * residual(1))) * basis1;
  normal->field_gradient.tail<kNumDepthFieldTerms>() +=
      (weight * whitening.w22 * residual(1)) * basis2;
}

void TwoViewCostFunction::LinearizeWhitened(const TwoViewModel& model,
                                            const DepthFields& fields,
                                            TwoViewCost* cost,
                                            NormalEquations* normal) {
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  whitenings_.assign(data_.Size(), Whitening());
  LossSum sum(options_.loss, max_sq_depth_);
  for (int i = 0; i < data_.Size(); ++i) {
    if (!data_.HasDepths(i)) continue;
    Transfer transfer;
    if (!Forward(model, fields, i, &transfer)) {
      sum.Add(2 * max_sq_depth_);
      continue;
    }
    whitenings_[i] = WhitenAt(model, F, transfer, i);
    const double weight = sum.Add(whitenings_[i](transfer).squaredNorm());
    if (weight == 0) continue;
    ++cost->num_depth_inliers;
    if (normal) AddWhitenedRows(i, model, transfer, weight, normal);
  }
  cost->depth += sum.Total();
}

void TwoViewCostFunction::AddReprojection(TransferDirection direction,
                                          const TwoViewModel& model,
                                          TwoViewCost* cost,
                                          NormalEquations* normal) const {
  LossSum sum(options_.loss, max_sq_epipolar_);
  for (int i = 0; i < data_.Size(); ++i) {
    if (!data_.HasDepths(i)) continue;
    Transfer transfer;
    if (!TransferMatch(direction,
                       model,
                       data_.points1[i],
                       data_.depths1[i],
                       data_.points2[i],
                       data_.depths2[i],
                       &transfer)) {
      continue;
    }
    const Eigen::Vector2d residual = reprojection_weight_ * transfer.error_px;
    const double weight = sum.Add(residual.squaredNorm());
    if (weight == 0) continue;
    ++cost->num_depth_inliers;
    if (!normal) continue;
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector2d axis =
          reprojection_weight_ * Eigen::Vector2d::Unit(k);
      AddRow(TransferGradient(direction, model, transfer, axis, 0),
             residual(k),
             weight,
             normal);
    }
  }
  cost->depth += sum.Total();
}

void TwoViewCostFunction::AddPriors(const TwoViewModel& model,
                                    const DepthFields& fields,
                                    TwoViewCost* cost,
                                    NormalEquations* normal) const {
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
  normal->field_matrix.diagonal().array() += field_weight;
  normal->field_gradient += field_weight * fields;
}

}  // namespace dgsfm
