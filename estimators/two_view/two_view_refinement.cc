#include "estimators/two_view/two_view_refinement.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

namespace dgsfm {
namespace {

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
                                    kNumCostParams,
                                    kNumCostParams>;
using ReducedVector = Eigen::
    Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kNumCostParams, 1>;

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

// The normal equations of the unknown parameters: those that the columns of the
// basis span, then the depth fields.
struct ReducedEquations {
  ReducedMatrix matrix;
  ReducedVector gradient;

  ReducedEquations(const NormalEquations& normal,
                   const Basis& basis,
                   bool has_fields) {
    const auto num_model = basis.cols();
    const auto num_fields = has_fields ? kNumCostParams - kNumTwoViewParams : 0;
    matrix.resize(num_model + num_fields, num_model + num_fields);
    gradient.resize(num_model + num_fields);
    matrix.topLeftCorner(num_model, num_model) = basis.transpose().lazyProduct(
        normal.matrix.topLeftCorner<kNumTwoViewParams, kNumTwoViewParams>()
            .lazyProduct(basis)
            .eval());
    matrix.bottomLeftCorner(num_fields, num_model) =
        normal.matrix.block(kNumTwoViewParams, 0, num_fields, kNumTwoViewParams)
            .lazyProduct(basis);
    matrix.topRightCorner(num_model, num_fields) =
        matrix.bottomLeftCorner(num_fields, num_model).transpose();
    matrix.bottomRightCorner(num_fields, num_fields) = normal.matrix.block(
        kNumTwoViewParams, kNumTwoViewParams, num_fields, num_fields);
    gradient.head(num_model) = basis.transpose().lazyProduct(
        normal.gradient.head<kNumTwoViewParams>());
    gradient.tail(num_fields) =
        normal.gradient.segment(kNumTwoViewParams, num_fields);
  }

  // Levenberg-Marquardt step.
  ReducedVector DampedStep(double damping) const {
    ReducedMatrix damped = matrix;
    damped.diagonal() *= 1 + damping;
    damped.diagonal().array() += 1e-12;
    return -damped.ldlt().solve(gradient);
  }
};

// Without depth the translation has unit length, which a step keeps to first
// order only.
TwoViewModel Moved(const TwoViewModel& model,
                   DepthTerm depth_term,
                   const TwoViewStep& step) {
  TwoViewModel moved = Retract(model, step);
  if (depth_term == DepthTerm::NONE) moved.translation.normalize();
  return moved;
}

}  // namespace

TwoViewCost RefineModel(const TwoViewData& data,
                        FocalCase focal_case,
                        const TwoViewCostOptions& cost_options,
                        const TwoViewRefinementOptions& options,
                        TwoViewModel* model,
                        DepthFields* fields) {
  // Steps that lower nothing are the end, not a matter of damping.
  constexpr int kMaxNumTries = 6;
  TwoViewCostFunction function(data, cost_options);
  NormalEquations normal;
  TwoViewCost cost;
  DepthFields zero_fields = DepthFields::Zero();
  if (!fields) fields = &zero_fields;
  double damping = 1e-3;
  for (int iteration = 0; iteration < options.max_num_iterations; ++iteration) {
    cost = function.Linearize(*model, *fields, &normal);
    const Basis basis =
        UnknownParameters(focal_case, cost_options.depth_term, *model);
    const ReducedEquations equations(normal, basis, function.HasFields());
    const double min_decrease = options.min_relative_decrease * cost.Total();
    bool improved = false;
    for (int k = 0; k < kMaxNumTries && !improved; ++k) {
      const ReducedVector step = equations.DampedStep(damping);
      if (!step.allFinite()) return cost;
      // What the linearisation promises is twice the decrease at most.
      if (-equations.gradient.dot(step) < min_decrease) return cost;
      const TwoViewModel moved =
          Moved(*model,
                cost_options.depth_term,
                basis.lazyProduct(step.head(basis.cols())));
      DepthFields moved_fields = *fields;
      if (function.HasFields()) {
        moved_fields += step.tail<2 * kNumDepthFieldTerms>();
      }
      const TwoViewCost moved_cost = function.Evaluate(moved, moved_fields);
      improved = moved.IsFinite() && moved_cost.Total() < cost.Total();
      damping = improved ? std::max(damping * 0.1, 1e-10) : damping * 10;
      if (!improved) continue;
      const double decrease = cost.Total() - moved_cost.Total();
      *model = moved;
      *fields = moved_fields;
      cost = moved_cost;
      if (decrease < min_decrease) return cost;
    }
    if (!improved) break;
  }
  return cost;
}

TwoViewMatrix EstimateCovariance(const TwoViewData& data,
                                 FocalCase focal_case,
                                 const TwoViewCostOptions& cost_options,
                                 const TwoViewModel& model,
                                 const DepthFields& fields) {
  NormalEquations normal;
  TwoViewCostFunction function(data, cost_options);
  function.Linearize(model, fields, &normal);
  const Basis basis =
      UnknownParameters(focal_case, cost_options.depth_term, model);
  ReducedMatrix information =
      ReducedEquations(normal, basis, function.HasFields()).matrix;
  // A little information about everything keeps the inverse finite.
  information.diagonal().array() += 1e-9;
  const auto size = information.rows();
  const ReducedMatrix inverse =
      information.ldlt().solve(ReducedMatrix::Identity(size, size));
  return basis * inverse.topLeftCorner(basis.cols(), basis.cols()) *
         basis.transpose();
}

}  // namespace dgsfm
