#include "estimators/global_positioning.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/option_check.h"
#include "estimators/ray_point_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>

#include <ceres/ceres.h>

namespace dgsfm {
namespace {

// Up to here the reduced camera matrix is cheaper dense than sparse.
constexpr int kMaxNumDenseCameras = 50;

void CheckInput(const std::vector<PositioningObservation>& observations,
                int fixed_camera,
                int num_cameras,
                int num_points) {
  DGSFM_CHECK(fixed_camera >= 0 && fixed_camera < num_cameras)
      << "fixed_camera = " << fixed_camera << " of " << num_cameras;
  for (const PositioningObservation& observation : observations) {
    DGSFM_CHECK(observation.camera >= 0 && observation.camera < num_cameras)
        << "camera " << observation.camera << " of " << num_cameras;
    DGSFM_CHECK(observation.point >= 0 && observation.point < num_points)
        << "point " << observation.point << " of " << num_points;
    // Negated to catch NaN.
    DGSFM_CHECK(std::abs(observation.ray_in_world.norm() - 1) < 1e-6)
        << "ray is no unit vector: " << observation.ray_in_world.transpose();
    DGSFM_CHECK(std::isfinite(observation.weight) && observation.weight > 0)
        << "weight = " << observation.weight;
  }
}

bool AllFinite(const std::vector<Eigen::Vector3d>& vectors) {
  return std::all_of(vectors.begin(), vectors.end(), [](const auto& vector) {
    return vector.allFinite();
  });
}

// Scaled about `center`, which moves to `new_center`.
std::vector<Eigen::Vector3d> Scaled(std::vector<Eigen::Vector3d> vectors,
                                    const Eigen::Vector3d& center,
                                    double scale,
                                    const Eigen::Vector3d& new_center) {
  for (Eigen::Vector3d& vector : vectors) {
    vector = new_center + scale * (vector - center);
  }
  return vectors;
}

// Logarithms of the distance between camera and point of each observation; a
// distance of zero counts as the smallest number.
std::vector<double> LogDistances(
    const std::vector<PositioningObservation>& observations,
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& points) {
  std::vector<double> log_distances;
  for (const PositioningObservation& observation : observations) {
    const double distance =
        (points[observation.point] - centers[observation.camera]).norm();
    log_distances.push_back(
        std::log(std::max(distance, std::numeric_limits<double>::min())));
  }
  return log_distances;
}

// Builds the problem and solves it in place. Centres and points each lie in
// one array: their addresses, by which Ceres orders them, follow the indices.
ceres::Solver::Summary Solve(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points) {
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::HuberLoss huber_loss(options.loss_scale);
  std::map<double, std::unique_ptr<ceres::LossFunction>> losses_by_weight;
  ceres::Problem problem(problem_options);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const PositioningObservation& observation : observations) {
    auto& loss = losses_by_weight[observation.weight];
    if (loss == nullptr) {
      loss = std::make_unique<ceres::ScaledLoss>(
          &huber_loss, observation.weight, ceres::DO_NOT_TAKE_OWNERSHIP);
    }
    double* center = (*centers)[observation.camera].data();
    double* point = (*points)[observation.point].data();
    problem.AddResidualBlock(new RayPointCostFunction(observation.ray_in_world),
                             loss.get(),
                             center,
                             point);
    ordering->AddElementToGroup(point, 0);
    ordering->AddElementToGroup(center, 1);
  }
  double* fixed_center = (*centers)[fixed_camera].data();
  if (problem.HasParameterBlock(fixed_center)) {
    problem.SetParameterBlockConstant(fixed_center);
  }

  ceres::Solver::Options solver_options;
  solver_options.minimizer_type = ceres::TRUST_REGION;
  solver_options.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  solver_options.use_nonmonotonic_steps = false;
  solver_options.linear_solver_type =
      ordering->GroupSize(1) <= kMaxNumDenseCameras ? ceres::DENSE_SCHUR
                                                    : ceres::SPARSE_SCHUR;
  solver_options.linear_solver_ordering = ordering;
  solver_options.jacobi_scaling = true;
  solver_options.max_num_iterations = options.max_num_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.gradient_tolerance = 1e-12;
  solver_options.parameter_tolerance = 1e-10;
  solver_options.num_threads = options.num_threads;
  solver_options.logging_type = ceres::SILENT;
  solver_options.minimizer_progress_to_stdout = false;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  return summary;
}

}  // namespace

bool GlobalPositioningOptions::IsValid(std::string* error) const {
  return CheckOption(max_num_iterations >= 1,
                     "max_num_iterations must be >= 1",
                     max_num_iterations,
                     error) &&
         CheckOption(
             loss_scale > 0, "loss_scale must be > 0", loss_scale, error) &&
         CheckOption(function_tolerance >= 0,
                     "function_tolerance must be >= 0",
                     function_tolerance,
                     error) &&
         CheckOption(
             num_threads >= 1, "num_threads must be >= 1", num_threads, error);
}

GlobalPositioningSummary SolveGlobalPositioning(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  CheckInput(observations, fixed_camera, centers->size(), points->size());
  GlobalPositioningSummary summary;
  if (observations.empty()) {
    summary.message = "no observations";
    return summary;
  }
  if (!AllFinite(*centers) || !AllFinite(*points)) {
    summary.message = "start is not finite";
    return summary;
  }

  // Solved about the fixed centre in units of the median distance: neither
  // the place of the world's origin nor its unit then change the damping.
  const std::vector<double> start_log_distances =
      LogDistances(observations, *centers, *points);
  const Eigen::Vector3d origin = (*centers)[fixed_camera];
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const double unit = std::exp(Median(start_log_distances));
  std::vector<Eigen::Vector3d> unit_centers =
      Scaled(*centers, origin, 1 / unit, zero);
  std::vector<Eigen::Vector3d> unit_points =
      Scaled(*points, origin, 1 / unit, zero);
  const ceres::Solver::Summary solver_summary =
      Solve(observations, fixed_camera, options, &unit_centers, &unit_points);
  // The first entry is the start.
  summary.num_iterations =
      std::max<int>(0, static_cast<int>(solver_summary.iterations.size()) - 1);
  summary.initial_cost = solver_summary.initial_cost;
  summary.final_cost = solver_summary.final_cost;
  summary.message = solver_summary.message;
  if (!solver_summary.IsSolutionUsable()) return summary;

  std::vector<double> log_growths =
      LogDistances(observations, unit_centers, unit_points);
  for (size_t k = 0; k < observations.size(); ++k) {
    log_growths[k] -= start_log_distances[k];
  }
  const double world_from_unit = std::exp(-Median(log_growths));
  const auto new_centers = Scaled(unit_centers, zero, world_from_unit, origin);
  const auto new_points = Scaled(unit_points, zero, world_from_unit, origin);
  if (!AllFinite(new_centers) || !AllFinite(new_points)) {
    summary.message = "solution is not finite";
    return summary;
  }
  for (const PositioningObservation& observation : observations) {
    (*centers)[observation.camera] = new_centers[observation.camera];
    (*points)[observation.point] = new_points[observation.point];
  }
  (*centers)[fixed_camera] = origin;
  summary.success = true;
  return summary;
}

}  // namespace dgsfm
