#include "tests/estimators/optimization/plain_positioning.h"

#include <algorithm>
#include <deque>
#include <type_traits>

#include <ceres/ceres.h>

namespace dgsfm {
namespace {

class ScaledRayCost : public ceres::SizedCostFunction<3, 3, 3, 1> {
 public:
  explicit ScaledRayCost(const Eigen::Vector3d& ray) : ray_(ray) {}

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> center(parameters[0]);
    const Eigen::Map<const Eigen::Vector3d> point(parameters[1]);
    const double scale = parameters[2][0];
    Eigen::Map<Eigen::Vector3d> residual(residuals);
    residual = ray_ - scale * (point - center);
    if (!jacobians) return true;
    using Jacobian = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    const auto set = [jacobians](int parameter, const auto& derivative) {
      if (!jacobians[parameter]) return;
      using Matrix = std::decay_t<decltype(derivative)>;
      Eigen::Map<Matrix> mapped(jacobians[parameter]);
      mapped = derivative;
    };
    const Jacobian by_center = scale * Jacobian::Identity();
    set(0, by_center);
    set(1, Jacobian(-by_center));
    set(2, Eigen::Vector3d(center - point));
    return true;
  }

 private:
  const Eigen::Vector3d ray_;
};

// The scale of the smallest residual.
double BestScale(const Eigen::Vector3d& ray, const Eigen::Vector3d& direction) {
  const double squared_norm = direction.squaredNorm();
  return squared_norm > 0 ? std::max(0.0, ray.dot(direction) / squared_norm)
                          : 1;
}

ceres::Solver::Options SolverOptions(const GlobalPositioningOptions& options) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  solver.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  solver.initial_trust_region_radius = 1e4;
  solver.max_num_iterations = options.max_num_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.gradient_tolerance = 1e-14;
  solver.parameter_tolerance = 1e-14;
  solver.num_threads = options.num_threads;
  solver.logging_type = ceres::SILENT;
  return solver;
}

}  // namespace

PointMinimizerSummary MinimizeWithScales(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points) {
  std::vector<double> scales;
  for (const PositioningObservation& observation : observations) {
    scales.push_back(BestScale(
        observation.ray_in_world,
        (*points)[observation.point] - (*centers)[observation.camera]));
  }
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::HuberLoss huber(options.loss_scale);
  std::deque<ceres::ScaledLoss> losses;
  ceres::Problem problem(ownership);
  for (size_t k = 0; k < observations.size(); ++k) {
    const PositioningObservation& observation = observations[k];
    losses.emplace_back(
        &huber, observation.weight, ceres::DO_NOT_TAKE_OWNERSHIP);
    problem.AddResidualBlock(new ScaledRayCost(observation.ray_in_world),
                             &losses.back(),
                             (*centers)[observation.camera].data(),
                             (*points)[observation.point].data(),
                             &scales[k]);
    problem.SetParameterLowerBound(&scales[k], 0, 0);
  }
  if (problem.HasParameterBlock((*centers)[fixed_camera].data())) {
    problem.SetParameterBlockConstant((*centers)[fixed_camera].data());
  }
  ceres::Solver::Summary solved;
  ceres::Solve(SolverOptions(options), &problem, &solved);
  PointMinimizerSummary summary;
  summary.success = solved.IsSolutionUsable();
  summary.converged = solved.termination_type == ceres::CONVERGENCE;
  summary.num_iterations =
      solved.num_successful_steps + solved.num_unsuccessful_steps;
  summary.initial_cost = solved.initial_cost;
  summary.final_cost = solved.final_cost;
  return summary;
}

}  // namespace dgsfm
