#include "estimators/two_view/two_view_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dgsfm {
namespace {

double Square(double x) { return x * x; }

// Adds the equations of the first parameters.
template <int kSize>
void Add(const LaneEquations<kSize>& equations, NormalEquations* normal) {
  const Lanes* entry = equations.matrix;
  for (int i = 0; i < kSize; ++i) {
    normal->gradient(i) += Sum(equations.gradient[i]);
    for (int j = 0; j <= i; ++j) normal->matrix(i, j) += Sum(*entry++);
  }
}

// Adds equations by parameters on which those of the model depend by `chain`.
template <int kSize>
void AddChained(const LaneEquations<kSize>& equations,
                const Eigen::Matrix<double, kSize, kNumTwoViewParams>& chain,
                NormalEquations* normal) {
  Eigen::Matrix<double, kSize, kSize> matrix;
  Eigen::Matrix<double, kSize, 1> gradient;
  const Lanes* entry = equations.matrix;
  for (int i = 0; i < kSize; ++i) {
    gradient(i) = Sum(equations.gradient[i]);
    for (int j = 0; j <= i; ++j) matrix(i, j) = matrix(j, i) = Sum(*entry++);
  }
  normal->matrix.topLeftCorner<kNumTwoViewParams, kNumTwoViewParams>() +=
      chain.transpose().lazyProduct(matrix.lazyProduct(chain).eval());
  normal->gradient.head<kNumTwoViewParams>() += chain.transpose() * gradient;
}

}  // namespace

TwoViewCostFunction::TwoViewCostFunction(const TwoViewData& data,
                                         const TwoViewCostOptions& options)
    : options_(options), matches_(CreateMatchLanes(data)) {
  epipolar_loss_ = {options.loss,
                    Square(options.max_epipolar_error_px / options.stddev_px)};
  switch (options.depth_term) {
    case DepthTerm::NONE:
      break;
    case DepthTerm::WHITENED:
      depth_loss_ = {options.loss, Square(options.max_depth_residual)};
      whitening_.stddev_px = options.stddev_px;
      whitening_.log_depth_stddev = options.log_depth_stddev;
      if (HasFields()) {
        whitening_.field_unit1_px = options.depth_field_unit1_px;
        whitening_.field_unit2_px = options.depth_field_unit2_px;
      }
      whitenings_.resize(matches_.size());
      break;
    case DepthTerm::REPROJECTION:
      depth_loss_ = epipolar_loss_;
      TwoViewData swapped;
      for (const TwoViewMatch& match : data) swapped.push_back(match.Swapped());
      swapped_matches_ = CreateMatchLanes(swapped);
      break;
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
  AddWhitened<kNumTwoViewParams>(
      model, DepthFields::Zero(), /*whiten=*/true, &cost, nullptr);
  return cost;
}

TwoViewCost TwoViewCostFunction::Sum(const TwoViewModel& model,
                                     const DepthFields& fields,
                                     NormalEquations* normal) {
  TwoViewCost cost;
  AddEpipolar(model, &cost, normal);
  if (options_.depth_term == DepthTerm::WHITENED) {
    // Costs compare only under one whitening: that of the linearisation.
    const bool whiten = normal != nullptr;
    if (HasFields()) {
      AddWhitened<kNumCostParams>(model, fields, whiten, &cost, normal);
    } else {
      AddWhitened<kNumTwoViewParams>(model, fields, whiten, &cost, normal);
    }
  } else if (options_.depth_term == DepthTerm::REPROJECTION) {
    AddReprojection(model, &cost, normal);
  }
  AddPriors(model, fields, &cost, normal);
  return cost;
}

void TwoViewCostFunction::AddEpipolar(const TwoViewModel& model,
                                      TwoViewCost* cost,
                                      NormalEquations* normal) const {
  // Summed over the entries of F, then chained to the parameters once.
  LaneEquations<9> equations;
  cost->epipolar += SumSampsonErrors(matches_,
                                     model,
                                     options_.stddev_px,
                                     epipolar_loss_,
                                     normal ? &equations : nullptr);
  if (normal) AddChained(equations, FundamentalMatrixJacobian(model), normal);
}

template <int kSize>
void TwoViewCostFunction::AddWhitened(const TwoViewModel& model,
                                      const DepthFields& fields,
                                      bool whiten,
                                      TwoViewCost* cost,
                                      NormalEquations* normal) {
  LaneEquations<kSize> equations;
  const DepthSum sum = SumWhitenedErrors(matches_,
                                         model,
                                         fields,
                                         whitening_,
                                         depth_loss_,
                                         whiten,
                                         &whitenings_,
                                         normal ? &equations : nullptr);
  cost->depth += sum.cost;
  cost->num_depth_inliers += sum.num_inliers;
  if (normal) Add(equations, normal);
}

void TwoViewCostFunction::AddReprojection(const TwoViewModel& model,
                                          TwoViewCost* cost,
                                          NormalEquations* normal) const {
  const double weight_per_px =
      options_.max_epipolar_error_px /
      (options_.stddev_px * options_.max_reprojection_error_px);
  for (const bool forward : {true, false}) {
    LaneEquations<kNumTwoViewParams> equations;
    const DepthSum sum =
        SumTransferErrors(forward ? matches_ : swapped_matches_,
                          forward ? model : model.Inverse(),
                          weight_per_px,
                          depth_loss_,
                          normal ? &equations : nullptr);
    cost->depth += sum.cost;
    cost->num_depth_inliers += sum.num_inliers;
    if (!normal) continue;
    const TwoViewMatrix chain =
        forward ? TwoViewMatrix::Identity() : InverseJacobian(model);
    AddChained(equations, chain, normal);
  }
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
