#include "estimators/two_view/two_view_refinement.h"

#include <algorithm>
#include <cmath>
#include <optional>

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

// Eliminates the depth fields from the equations of the model; their step is
// that of the model times this, plus the constant.
struct FieldElimination {
  Eigen::Matrix<double, 2 * kNumDepthFieldTerms, kNumTwoViewParams> slope;
  DepthFields constant;

  explicit FieldElimination(NormalEquations* normal) {
    const auto factorization = normal->field_matrix.llt();
    slope = -factorization.solve(normal->cross.transpose());
    constant = -factorization.solve(normal->field_gradient);
    normal->matrix += normal->cross.lazyProduct(slope);
    normal->gradient += normal->cross * constant;
  }
};

// Levenberg-Marquardt step of the damped normal equations, in the basis.
ReducedVector DampedStep(const ReducedMatrix& matrix,
                         const ReducedVector& gradient,
                         double damping) {
  ReducedMatrix damped = matrix;
  damped.diagonal() *= 1 + damping;
  damped.diagonal().array() += 1e-12;
  return -damped.ldlt().solve(gradient);
}

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
    std::optional<FieldElimination> elimination;
    if (function.HasFields()) elimination.emplace(&normal);
    const Basis basis =
        UnknownParameters(focal_case, cost_options.depth_term, *model);
    const ReducedMatrix matrix =
        basis.transpose().lazyProduct(normal.matrix.lazyProduct(basis).eval());
    const ReducedVector gradient =
        basis.transpose().lazyProduct(normal.gradient);
    const double min_decrease = options.min_relative_decrease * cost.Total();
    bool improved = false;
    for (int k = 0; k < kMaxNumTries && !improved; ++k) {
      const ReducedVector step = DampedStep(matrix, gradient, damping);
      if (!step.allFinite()) return cost;
      // What the linearisation promises is twice the decrease at most.
      double decrease_bound = -gradient.dot(step);
      if (elimination) {
        decrease_bound -= normal.field_gradient.dot(elimination->constant);
      }
      if (decrease_bound < min_decrease) return cost;
      const TwoViewStep full_step = basis.lazyProduct(step);
      const TwoViewModel moved =
          Moved(*model, cost_options.depth_term, full_step);
      DepthFields moved_fields = *fields;
      if (elimination) {
        moved_fields += elimination->constant + elimination->slope * full_step;
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
  if (function.HasFields()) FieldElimination{&normal};
  const Basis basis =
      UnknownParameters(focal_case, cost_options.depth_term, model);
  // A little information about everything keeps the inverse finite.
  const ReducedMatrix information =
      basis.transpose() * normal.matrix * basis +
      1e-9 * ReducedMatrix::Identity(basis.cols(), basis.cols());
  const ReducedMatrix inverse = information.ldlt().solve(
      ReducedMatrix::Identity(basis.cols(), basis.cols()));
  return basis * inverse * basis.transpose();
}

}  // namespace dgsfm
