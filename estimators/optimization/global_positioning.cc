#include "estimators/optimization/global_positioning.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/optimization/point_minimizer.h"
#include "estimators/optimization/ray_point_residual.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace dgsfm {
namespace {

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
    DGSFM_CHECK(std::isfinite(observation.log_distance) &&
                std::isfinite(observation.log_distance_stddev) &&
                observation.log_distance_stddev >= 0)
        << "log distance " << observation.log_distance << " +- "
        << observation.log_distance_stddev;
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

// Logarithms of the distance between camera and point of each observation.
std::vector<double> LogDistances(
    const std::vector<PositioningObservation>& observations,
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& points) {
  std::vector<double> log_distances;
  for (const PositioningObservation& observation : observations) {
    log_distances.push_back(LogDistance(
        points[observation.point] - centers[observation.camera], nullptr));
  }
  return log_distances;
}

// The rays, and with kNumFactors = 1 the log distances as well, whose factors
// are a fourth parameter of each camera.
template <int kNumFactors>
class PositioningProblem
    : public PointProblem<3 + kNumFactors, 3 + kNumFactors> {
 public:
  using Base = PointProblem<3 + kNumFactors, 3 + kNumFactors>;
  using Row = typename Base::Row;

  PositioningProblem(const std::vector<PositioningObservation>& all,
                     int fixed_camera,
                     const GlobalPositioningOptions& options,
                     const std::vector<int>& body_of_camera,
                     double unit,
                     std::vector<Eigen::Vector3d>* centers,
                     std::vector<Eigen::Vector3d>* points)
      : observations_(all),
        options_(options),
        log_unit_(std::log(unit)),
        centers_(*centers),
        points_(*points),
        log_factors_(centers->size(), 0),
        depth_weights_(centers->size(), 0) {
    std::stable_sort(observations_.begin(),
                     observations_.end(),
                     [](const auto& a, const auto& b) {
                       return std::tie(a.point, a.camera) <
                              std::tie(b.point, b.camera);
                     });
    this->observation_index.num_cameras = int(centers->size());
    this->observation_index.num_points = int(points->size());
    this->camera_columns.resize(centers->size());
    for (auto& columns : this->camera_columns) columns.fill(-1);
    std::vector<int> first_columns(centers->size(), -1);
    for (const PositioningObservation& observation : observations_) {
      const int camera = observation.camera;
      this->observation_index.cameras.push_back(camera);
      this->observation_index.points.push_back(observation.point);
      const int body = body_of_camera[camera];
      if (body != body_of_camera[fixed_camera] && first_columns[body] < 0) {
        first_columns[body] = this->num_columns;
        this->num_columns += 3;
      }
      auto& columns = this->camera_columns[camera];
      if (kNumFactors == 0 || observation.log_distance_stddev == 0) continue;
      // The number of depths, at first.
      depth_weights_[camera] += 1;
      if (columns.back() < 0) columns.back() = this->num_columns++;
    }
    for (size_t camera = 0; camera < centers->size(); ++camera) {
      const int first = first_columns[body_of_camera[camera]];
      for (int i = 0; first >= 0 && i < 3; ++i) {
        this->camera_columns[camera][i] = first + i;
      }
    }
    for (double& weight : depth_weights_) {
      weight = options.ray_stddev * options.ray_stddev *
               std::min(1.0, options.max_num_depths / std::max(weight, 1.0));
    }
  }

  double Cost(int k) const override {
    const double error = RayResidual(k, nullptr).norm();
    const double scale = options_.loss_scale;
    const double cost =
        observations_[k].weight *
        (error <= scale ? 0.5 * error * error : scale * (error - 0.5 * scale));
    if (!HasDepth(k)) return cost;
    const double depth_error = DepthError(k, nullptr);
    return cost + 0.5 * depth_weights_[observations_[k].camera] *
                      std::log1p(depth_error * depth_error);
  }

  void Linearize(int k, Row* row) const override {
    row->residual.setZero();
    row->by_point.setZero();
    row->by_camera.setZero();
    Eigen::Matrix3d by_point;
    const Eigen::Vector3d residual = RayResidual(k, &by_point);
    const double error = residual.norm();
    // Ceres's correction for losses of negative or no curvature.
    const double factor = std::sqrt(
        observations_[k].weight *
        (error <= options_.loss_scale ? 1 : options_.loss_scale / error));
    row->residual.template head<3>() = factor * residual;
    row->by_point.template leftCols<3>() = factor * by_point.transpose();
    if (HasDepth(k)) LinearizeDepth(k, row);
    row->by_camera.template topRows<3>() = -row->by_point;
  }

  double TermsCost() const override {
    double cost = 0;
    for (const double log_factor : log_factors_) {
      cost += 0.5 * FactorWeight() * log_factor * log_factor;
    }
    return cost;
  }

  void LinearizeTerms(typename Base::Triplets* hessian,
                      Eigen::VectorXd* gradient) const override {
    for (size_t i = 0; kNumFactors > 0 && i < log_factors_.size(); ++i) {
      const int column = this->camera_columns[i].back();
      if (column < 0) continue;
      hessian->emplace_back(column, column, FactorWeight());
      (*gradient)(column) += FactorWeight() * log_factors_[i];
    }
  }

  void Step(const Eigen::VectorXd& column_steps,
            const std::vector<Eigen::Vector3d>& point_steps) override {
    saved_centers_ = centers_;
    saved_points_ = points_;
    saved_log_factors_ = log_factors_;
    for (size_t i = 0; i < centers_.size(); ++i) {
      const auto& columns = this->camera_columns[i];
      if (columns[0] >= 0) {
        centers_[i] += column_steps.template segment<3>(columns[0]);
      }
      if (kNumFactors > 0 && columns.back() >= 0) {
        log_factors_[i] += column_steps(columns.back());
      }
    }
    for (size_t i = 0; i < points_.size(); ++i) points_[i] += point_steps[i];
  }

  void Undo() override {
    centers_.swap(saved_centers_);
    points_.swap(saved_points_);
    log_factors_.swap(saved_log_factors_);
  }

  Eigen::Vector3d& Point(int point) override { return points_[point]; }

 private:
  Eigen::Vector3d Direction(int k) const {
    return points_[observations_[k].point] - centers_[observations_[k].camera];
  }

  Eigen::Vector3d RayResidual(int k, Eigen::Matrix3d* by_point) const {
    return RayPointResidual(
        observations_[k].ray_in_world, Direction(k), by_point);
  }

  bool HasDepth(int k) const {
    return kNumFactors > 0 && observations_[k].log_distance_stddev > 0;
  }

  // In standard deviations.
  double DepthError(int k, Eigen::Vector3d* by_point) const {
    const PositioningObservation& observation = observations_[k];
    return (LogDistance(Direction(k), by_point) + log_unit_ -
            observation.log_distance - log_factors_[observation.camera]) /
           observation.log_distance_stddev;
  }

  void LinearizeDepth(int k, Row* row) const {
    constexpr int kLast = 2 + kNumFactors;
    const PositioningObservation& observation = observations_[k];
    Eigen::Vector3d by_point;
    const double error = DepthError(k, &by_point);
    const double factor =
        std::sqrt(depth_weights_[observation.camera] / (1 + error * error));
    row->residual(kLast) = factor * error;
    row->by_point.col(kLast) =
        factor / observation.log_distance_stddev * by_point;
    row->by_camera(kLast, kLast) = -factor / observation.log_distance_stddev;
  }

  double FactorWeight() const {
    const double ratio = options_.ray_stddev / options_.log_factor_stddev;
    return ratio * ratio;
  }

  std::vector<PositioningObservation> observations_;
  const GlobalPositioningOptions& options_;
  const double log_unit_;
  std::vector<Eigen::Vector3d>& centers_;
  std::vector<Eigen::Vector3d>& points_;
  std::vector<double> log_factors_;
  // Weight of one log distance of each camera [1 / variance].
  std::vector<double> depth_weights_;
  std::vector<Eigen::Vector3d> saved_centers_, saved_points_;
  std::vector<double> saved_log_factors_;
};

template <int kNumFactors>
PointMinimizerSummary MinimizeWithoutScales(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    const std::vector<int>& body_of_camera,
    double unit,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points) {
  PositioningProblem<kNumFactors> problem(observations,
                                          fixed_camera,
                                          options,
                                          body_of_camera,
                                          unit,
                                          centers,
                                          points);
  PointMinimizerOptions minimizer;
  minimizer.max_num_iterations = options.max_num_iterations;
  minimizer.function_tolerance = options.function_tolerance;
  minimizer.num_threads = options.num_threads;
  minimizer.refine_points = false;
  return MinimizeWithPoints<3 + kNumFactors, 3 + kNumFactors>(minimizer,
                                                              &problem);
}

}  // namespace

bool GlobalPositioningOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_num_iterations", max_num_iterations, 1)
      .Above("loss_scale", loss_scale, 0)
      .AtLeast("function_tolerance", function_tolerance, 0)
      .Above("ray_stddev", ray_stddev, 0)
      .Above("max_num_depths", max_num_depths, 0)
      .Above("log_factor_stddev", log_factor_stddev, 0)
      .AtLeast("num_threads", num_threads, 1)
      .AreKept();
}

GlobalPositioningSummary SolveGlobalPositioning(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points,
    const PositioningBodies& bodies) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  CheckInput(observations, fixed_camera, centers->size(), points->size());
  std::vector<int> body_of_camera = bodies.body_of_camera;
  if (body_of_camera.empty()) {
    body_of_camera.resize(centers->size());
    std::iota(body_of_camera.begin(), body_of_camera.end(), 0);
  }
  DGSFM_CHECK(body_of_camera.size() == centers->size());
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
  const bool has_depth =
      options.use_depth &&
      std::any_of(observations.begin(),
                  observations.end(),
                  [](const PositioningObservation& observation) {
                    return observation.log_distance_stddev > 0;
                  });
  const auto minimize =
      has_depth ? MinimizeWithoutScales<1> : MinimizeWithoutScales<0>;
  const PointMinimizerSummary found = minimize(observations,
                                               fixed_camera,
                                               options,
                                               body_of_camera,
                                               unit,
                                               &unit_centers,
                                               &unit_points);
  if (!found.success) {
    summary.message = "the solver found no usable solution";
    return summary;
  }
  summary.converged = found.converged;
  summary.num_iterations = found.num_iterations;
  summary.initial_cost = found.initial_cost;
  summary.final_cost = found.final_cost;

  std::vector<double> log_growths =
      LogDistances(observations, unit_centers, unit_points);
  for (size_t k = 0; k < observations.size(); ++k) {
    log_growths[k] -= start_log_distances[k];
  }
  const double world_from_unit =
      bodies.fix_scale ? unit : std::exp(-Median(log_growths));
  const auto new_centers = Scaled(unit_centers, zero, world_from_unit, origin);
  const auto new_points = Scaled(unit_points, zero, world_from_unit, origin);
  if (!AllFinite(new_centers) || !AllFinite(new_points)) {
    summary.message = "solution is not finite";
    return summary;
  }
  std::vector<char> has_moved(centers->size(), false);
  for (const PositioningObservation& observation : observations) {
    has_moved[body_of_camera[observation.camera]] = true;
    (*points)[observation.point] = new_points[observation.point];
  }
  for (size_t camera = 0; camera < centers->size(); ++camera) {
    if (has_moved[body_of_camera[camera]]) {
      (*centers)[camera] = new_centers[camera];
    }
  }
  (*centers)[fixed_camera] = origin;
  summary.success = true;
  return summary;
}

}  // namespace dgsfm
