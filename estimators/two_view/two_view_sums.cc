#include "estimators/two_view/two_view_sums.h"

#include <cmath>

#include <Eigen/Core>

namespace dgsfm {
namespace {

// Sum of robustified squares. Squares are normalised by the truncation; sums of
// logarithms are logarithms of products, which need one logarithm for many.
class LossSum {
 public:
  explicit LossSum(const TwoViewLossOptions& options)
      : loss_(options.loss),
        max_sq_error_(options.max_sq_error),
        inverse_max_sq_error_(1 / options.max_sq_error) {}

  // Returns the derivatives of the robustified squares. Squares of zero add
  // nothing.
  DGSFM_INLINE Lanes Add(const Lanes& sq_errors) {
    const Lanes ratio = sq_errors * inverse_max_sq_error_;
    if (loss_ == TwoViewLoss::TRUNCATED_SQUARES) {
      // Also if it is not a number.
      total_ += ratio < 1.0 ? sq_errors : Lanes{} + max_sq_error_;
      return ratio < 1.0 ? Lanes{} + 1.0 : Lanes{};
    }
    const Lanes factor = 1 + ratio;
    if (loss_ == TwoViewLoss::CAUCHY) {
      Multiply(factor);
      return 1 / factor;
    }
    Multiply(ratio < 1.0 ? factor : Lanes{} + 2.0);
    return ratio < 1.0 ? 1 / factor : Lanes{};
  }

  double Total() const {
    double total = Sum(total_);
    for (int k = 0; k < kNumLanes; ++k) {
      total += max_sq_error_ * std::log(product_[k]);
    }
    return total;
  }

 private:
  // Far enough from the largest number for one more factor.
  static constexpr double kMaxProduct = 1e100;

  DGSFM_INLINE void Multiply(const Lanes& factor) {
    product_ *= factor;
    for (int k = 0; k < kNumLanes; ++k) {
      if (product_[k] > kMaxProduct) {
        total_[k] += max_sq_error_ * std::log(product_[k]);
        product_[k] = 1;
      }
    }
  }

  const TwoViewLoss loss_;
  const double max_sq_error_;
  const double inverse_max_sq_error_;
  Lanes total_ = {};
  Lanes product_ = Lanes{} + 1.0;
};

// The first kSize1 entries of row 1 are not zero.
template <int kSize1, int kSize>
DGSFM_INLINE void AddRows(const Lanes (&row1)[kSize1],
                          const Lanes& residual1,
                          const Lanes (&row2)[kSize],
                          const Lanes& residual2,
                          const Lanes& weight,
                          LaneEquations<kSize>* equations) {
  Lanes* matrix = equations->matrix;
  for (int i = 0; i < kSize; ++i) {
    const Lanes weighted2 = weight * row2[i];
    if (i < kSize1) {
      const Lanes weighted1 = weight * row1[i];
      equations->gradient[i] += residual1 * weighted1 + residual2 * weighted2;
      for (int j = 0; j <= i; ++j) {
        *matrix++ += weighted1 * row1[j] + weighted2 * row2[j];
      }
    } else {
      equations->gradient[i] += residual2 * weighted2;
      for (int j = 0; j <= i; ++j) *matrix++ += weighted2 * row2[j];
    }
  }
}

template <int kSize>
DGSFM_INLINE void AddRow(const Lanes (&row)[kSize],
                         const Lanes& residual,
                         const Lanes& weight,
                         LaneEquations<kSize>* equations) {
  Lanes* matrix = equations->matrix;
  for (int i = 0; i < kSize; ++i) {
    const Lanes weighted = weight * row[i];
    equations->gradient[i] += residual * weighted;
    for (int j = 0; j <= i; ++j) *matrix++ += weighted * row[j];
  }
}

// Adds the derivatives of the whitened residuals of eight matches.
template <int kSize>
DGSFM_INLINE void AddWhitenedRows(const TwoViewModel& model,
                                  const TransferLanes& transfer,
                                  const WhiteningLanes& whitening,
                                  const FieldLanes& field1,
                                  const FieldLanes& field2,
                                  const Lanes& residual1,
                                  const Lanes& residual2,
                                  const Lanes& weight,
                                  LaneEquations<kSize>* equations) {
  constexpr bool kHasFields = kSize == kNumCostParams;
  constexpr int kSize1 = kHasFields ? kSize - kNumDepthFieldTerms : kSize;
  const Lanes weights1[2] = {whitening.w11 * whitening.direction[0],
                             whitening.w11 * whitening.direction[1]};
  const Lanes weights2[2] = {whitening.w21 * whitening.direction[0],
                             whitening.w21 * whitening.direction[1]};
  Lanes row1[kSize1], row2[kSize];
  TransferGradient(model, transfer, weights1, Lanes{}, row1);
  TransferGradient(model, transfer, weights2, whitening.w22, row2);
  if constexpr (kHasFields) {
    // The field of map 1 moves the transferred point, that of map 2 the depth
    // it is compared with.
    const Lanes slope1 = -whitening.w11 * whitening.shift;
    const Lanes slope2 =
        -(whitening.w21 * whitening.shift + whitening.w22 * whitening.slope);
    for (int k = 0; k < kNumDepthFieldTerms; ++k) {
      row1[kNumTwoViewParams + k] = slope1 * field1.basis[k];
      row2[kNumTwoViewParams + k] = slope2 * field1.basis[k];
      row2[kNumTwoViewParams + kNumDepthFieldTerms + k] =
          whitening.w22 * field2.basis[k];
    }
  }
  AddRows(row1, residual1, row2, residual2, weight, equations);
}

}  // namespace

DGSFM_TARGET_CLONES
double SumSampsonErrors(const std::vector<MatchLanes>& matches,
                        const TwoViewModel& model,
                        double stddev_px,
                        const TwoViewLossOptions& loss,
                        LaneEquations<9>* equations) {
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  const double inverse_stddev = 1 / stddev_px;
  LossSum sum(loss);
  for (const MatchLanes& match : matches) {
    Lanes row[9];
    const Lanes residual =
        match.is_match * inverse_stddev *
        SampsonErrors(F.data(), match, equations ? &row : nullptr);
    const Lanes weight = sum.Add(residual * residual);
    if (!equations) continue;
    for (Lanes& entry : row) entry *= inverse_stddev;
    AddRow(row, residual, weight * match.is_match, equations);
  }
  return sum.Total();
}

DGSFM_TARGET_CLONES
DepthSum SumTransferErrors(const std::vector<MatchLanes>& matches,
                           const TwoViewModel& model,
                           double weight_per_px,
                           const TwoViewLossOptions& loss,
                           LaneEquations<kNumTwoViewParams>* equations) {
  const Lanes one = Lanes{} + 1.0;
  LossSum sum(loss);
  Lanes num_inliers = {};
  for (const MatchLanes& match : matches) {
    const TransferLanes transfer = TransferPoints(model, match, match.depth1);
    const Lanes scale = model.focal2 * transfer.inverse_z;
    const Lanes is_counted = match.has_depths * transfer.is_in_front;
    Lanes residuals[2];
    for (int k = 0; k < 2; ++k) {
      residuals[k] = is_counted * weight_per_px *
                     (scale * transfer.point[k] - match.x2[k]);
    }
    const Lanes weight = is_counted * sum.Add(residuals[0] * residuals[0] +
                                              residuals[1] * residuals[1]);
    num_inliers += weight > 0.0 ? one : Lanes{};
    if (!equations) continue;
    const Lanes x_weights[2] = {weight_per_px * one, Lanes{}};
    const Lanes y_weights[2] = {Lanes{}, weight_per_px * one};
    Lanes row1[kNumTwoViewParams], row2[kNumTwoViewParams];
    TransferGradient(model, transfer, x_weights, Lanes{}, row1);
    TransferGradient(model, transfer, y_weights, Lanes{}, row2);
    AddRows(row1, residuals[0], row2, residuals[1], weight, equations);
  }
  return {sum.Total(), static_cast<int>(Sum(num_inliers))};
}

template <int kSize>
DGSFM_TARGET_CLONES DepthSum
SumWhitenedErrors(const std::vector<MatchLanes>& matches,
                  const TwoViewModel& model,
                  const DepthFields& fields,
                  const WhiteningOptions& options,
                  const TwoViewLossOptions& loss,
                  bool whiten,
                  std::vector<WhiteningLanes>* whitenings,
                  LaneEquations<kSize>* equations) {
  const Eigen::Matrix3d F = model.FundamentalMatrix();
  const double log_scale = std::log(model.scale);
  LossSum sum(loss);
  Lanes num_inliers = {};
  for (size_t i = 0; i < matches.size(); ++i) {
    const MatchLanes& match = matches[i];
    const FieldLanes field1 =
        EvaluateField(match.x1, options.field_unit1_px, fields.data());
    const FieldLanes field2 = EvaluateField(
        match.x2, options.field_unit2_px, fields.data() + kNumDepthFieldTerms);
    Lanes depth1 = match.depth1;
    if (options.field_unit1_px > 0) {
      for (int k = 0; k < kNumLanes; ++k)
        depth1[k] *= std::exp(-field1.value[k]);
    }
    const TransferLanes transfer = TransferPoints(model, match, depth1);
    WhiteningLanes& whitening = (*whitenings)[i];
    if (whiten) {
      whitening = WhiteningAt(model, F.data(), options, match, transfer);
    }
    const Lanes scale = model.focal2 * transfer.inverse_z;
    const Lanes along =
        whitening.direction[0] * (scale * transfer.point[0] - match.x2[0]) +
        whitening.direction[1] * (scale * transfer.point[1] - match.x2[1]);
    const Lanes log_ratio =
        Log(transfer.point[2]) - log_scale - match.log_depth2 + field2.value;
    const Lanes residual1 = whitening.w11 * along;
    const Lanes residual2 = whitening.w21 * along + whitening.w22 * log_ratio;
    Lanes sq_errors = residual1 * residual1 + residual2 * residual2;
    // Twice the truncation is an outlier under every loss.
    const Lanes is_valid = whitening.w11 > 0.0 ? transfer.is_in_front : Lanes{};
    sq_errors = is_valid > 0.0 ? sq_errors : Lanes{} + 2 * loss.max_sq_error;
    sq_errors = match.has_depths > 0.0 ? sq_errors : Lanes{};
    Lanes weight = sum.Add(sq_errors);
    weight = match.has_depths > 0.0 ? weight : Lanes{};
    weight = is_valid > 0.0 ? weight : Lanes{};
    num_inliers += weight > 0.0 ? Lanes{} + 1.0 : Lanes{};
    if (equations) {
      AddWhitenedRows(model,
                      transfer,
                      whitening,
                      field1,
                      field2,
                      residual1,
                      residual2,
                      weight,
                      equations);
    }
  }
  return {sum.Total(), static_cast<int>(Sum(num_inliers))};
}

template DepthSum SumWhitenedErrors(const std::vector<MatchLanes>&,
                                    const TwoViewModel&,
                                    const DepthFields&,
                                    const WhiteningOptions&,
                                    const TwoViewLossOptions&,
                                    bool,
                                    std::vector<WhiteningLanes>*,
                                    LaneEquations<kNumTwoViewParams>*);
template DepthSum SumWhitenedErrors(const std::vector<MatchLanes>&,
                                    const TwoViewModel&,
                                    const DepthFields&,
                                    const WhiteningOptions&,
                                    const TwoViewLossOptions&,
                                    bool,
                                    std::vector<WhiteningLanes>*,
                                    LaneEquations<kNumCostParams>*);

}  // namespace dgsfm
