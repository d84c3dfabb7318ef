#include "estimators/optimization/global_positioning.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/optimization/point_minimizer.h"
#include "estimators/optimization/ray_point_residual.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

namespace dgsfm {
namespace {

// Fixed camera where none is.
constexpr int kNoCamera = -1;

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

// About `origin` in another unit.
PositioningPriors Scaled(PositioningPriors priors,
                         const Eigen::Vector3d& origin,
                         double unit) {
  for (CenterPrior& prior : priors.centers) {
    prior.center = (prior.center - origin) / unit;
    prior.sqrt_information *= unit;
  }
  return priors;
}

// Logarithms of the distance between camera and point of each observation.
std::vector<double> LogDistances(
    const std::vector<PositioningObservation>& observations,
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& points) {
  std::vector<double> log_distances;
  for (const PositioningObservation& observation : observations) {
    const double distance =
        (points[observation.point] - centers[observation.camera]).norm();
    // A point in its camera's centre must not turn medians into infinities.
    log_distances.push_back(
        std::log(std::max(distance, std::numeric_limits<double>::min())));
  }
  return log_distances;
}

class PositioningProblem : public PointProblem<3, 3> {
 public:
  // The observations are sorted by point and then by camera.
  PositioningProblem(const std::vector<PositioningObservation>& observations,
                     int fixed_camera,
                     const std::vector<int>& body_of_camera,
                     const PositioningPriors& priors,
                     double loss_scale,
                     std::vector<Eigen::Vector3d>* centers,
                     std::vector<Eigen::Vector3d>* points)
      : observations_(observations),
        priors_(priors),
        loss_scale_(loss_scale),
        centers_(*centers),
        points_(*points) {
    observation_index.num_cameras = int(centers->size());
    observation_index.num_points = int(points->size());
    std::vector<CameraColumns> body_columns(centers->size(), {-1, -1, -1});
    const int fixed_body =
        fixed_camera == kNoCamera ? kNoCamera : body_of_camera[fixed_camera];
    observation_index.cameras.reserve(observations_.size());
    observation_index.points.reserve(observations_.size());
    for (const PositioningObservation& observation : observations_) {
      observation_index.cameras.push_back(observation.camera);
      observation_index.points.push_back(observation.point);
      const int body = body_of_camera[observation.camera];
      auto& columns = body_columns[body];
      if (body == fixed_body || columns[0] >= 0) continue;
      for (int& column : columns) column = num_columns++;
    }
    for (const int body : body_of_camera) {
      camera_columns.push_back(body_columns[body]);
    }
  }

  double Cost(int k) const override {
    const double error = Residual(k, nullptr).norm();
    return observations_[k].weight *
           (error <= loss_scale_ ? 0.5 * error * error
                                 : loss_scale_ * (error - 0.5 * loss_scale_));
  }

  void Linearize(int k, Row* row) const override {
    Eigen::Matrix3d by_point;
    const Eigen::Vector3d residual = Residual(k, &by_point);
    const double error = residual.norm();
    // The loss has no positive curvature beyond its scale, so that its weight
    // alone keeps the normal matrix positive.
    const double factor =
        std::sqrt(observations_[k].weight *
                  (error <= loss_scale_ ? 1 : loss_scale_ / error));
    row->residual = factor * residual;
    row->by_point = factor * by_point.transpose();
    row->by_camera = -row->by_point;
  }

  double TermsCost() const override {
    double cost = 0;
    for (size_t i = 0; i < priors_.centers.size(); ++i) {
      if (!priors_.centers[i].Exists()) continue;
      cost += CenterPriorCost(priors_.centers[i], priors_.weight, centers_[i]);
    }
    return cost;
  }

  void LinearizeTerms(Triplets* hessian,
                      Eigen::VectorXd* gradient) const override {
    for (size_t i = 0; i < priors_.centers.size(); ++i) {
      LinearizeCenterPrior(priors_.centers[i],
                           priors_.weight,
                           centers_[i],
                           Eigen::Matrix3d::Identity(),
                           camera_columns[i].data(),
                           hessian,
                           gradient);
    }
  }

  void Step(const Eigen::VectorXd& column_steps,
            const std::vector<Eigen::Vector3d>& point_steps) override {
    saved_centers_ = centers_;
    saved_points_ = points_;
    for (size_t i = 0; i < centers_.size(); ++i) {
      const int column = camera_columns[i][0];
      if (column >= 0) centers_[i] += column_steps.segment<3>(column);
    }
    for (size_t i = 0; i < points_.size(); ++i) points_[i] += point_steps[i];
  }

  void Undo() override {
    centers_.swap(saved_centers_);
    points_.swap(saved_points_);
  }

  Eigen::Vector3d& Point(int point) override { return points_[point]; }

 private:
  Eigen::Vector3d Residual(int k, Eigen::Matrix3d* by_point) const {
    const PositioningObservation& observation = observations_[k];
    return RayPointResidual(
        observation.ray_in_world,
        points_[observation.point] - centers_[observation.camera],
        by_point);
  }

  const std::vector<PositioningObservation>& observations_;
  const PositioningPriors& priors_;
  const double loss_scale_;
  std::vector<Eigen::Vector3d>& centers_;
  std::vector<Eigen::Vector3d>& points_;
  std::vector<Eigen::Vector3d> saved_centers_, saved_points_;
};

PointMinimizerSummary Minimize(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    const std::vector<int>& body_of_camera,
    const PositioningPriors& priors,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points) {
  PositioningProblem problem(observations,
                             fixed_camera,
                             body_of_camera,
                             priors,
                             options.loss_scale,
                             centers,
                             points);
  PointMinimizerOptions minimizer;
  minimizer.label = "Global positioning";
  minimizer.max_num_iterations = options.max_num_iterations;
  minimizer.function_tolerance = options.function_tolerance;
  minimizer.num_threads = options.num_threads;
  // Cameras have far to go here; points that settle early would hold them.
  minimizer.refine_points = false;
  return MinimizeWithPoints<3, 3>(minimizer, &problem);
}

// Each camera moves by itself where bodies are not given.
std::vector<int> BodiesOfCameras(const PositioningBodies& bodies,
                                 size_t num_cameras) {
  std::vector<int> body_of_camera = bodies.body_of_camera;
  if (body_of_camera.empty()) {
    body_of_camera.resize(num_cameras);
    std::iota(body_of_camera.begin(), body_of_camera.end(), 0);
  }
  DGSFM_CHECK(body_of_camera.size() == num_cameras);
  return body_of_camera;
}

// Empty if there is something to solve.
std::string WhyNotToSolve(
    const std::vector<PositioningObservation>& observations,
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& points) {
  if (observations.empty()) return "no observations";
  if (!AllFinite(centers) || !AllFinite(points)) return "start is not finite";
  return "";
}

void SortByPoints(std::vector<PositioningObservation>* observations) {
  const auto is_before = [](const auto& a, const auto& b) {
    return std::tie(a.point, a.camera) < std::tie(b.point, b.camera);
  };
  if (!std::is_sorted(observations->begin(), observations->end(), is_before)) {
    std::stable_sort(observations->begin(), observations->end(), is_before);
  }
}

bool HasPriors(const PositioningPriors& priors) {
  return std::any_of(priors.centers.begin(),
                     priors.centers.end(),
                     [](const auto& prior) { return prior.Exists(); });
}

// Factor by which distances of observations were larger at the start.
double MedianShrinkage(const std::vector<double>& start_log_distances,
                       std::vector<double> log_distances) {
  for (size_t k = 0; k < log_distances.size(); ++k) {
    log_distances[k] -= start_log_distances[k];
  }
  return std::exp(-Median(std::move(log_distances)));
}

// Moves points with observations, and cameras whose body has any.
void MoveObserved(const std::vector<PositioningObservation>& observations,
                  const std::vector<int>& body_of_camera,
                  const std::vector<Eigen::Vector3d>& new_centers,
                  const std::vector<Eigen::Vector3d>& new_points,
                  std::vector<Eigen::Vector3d>* centers,
                  std::vector<Eigen::Vector3d>* points) {
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
}

}  // namespace

bool GlobalPositioningOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_num_iterations", max_num_iterations, 1)
      .Above("loss_scale", loss_scale, 0)
      .AtLeast("function_tolerance", function_tolerance, 0)
      .AtLeast("num_threads", num_threads, 1)
      .AreKept();
}

GlobalPositioningSummary SolveGlobalPositioning(
    std::vector<PositioningObservation> observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points,
    const PositioningBodies& bodies,
    const PositioningPriors& priors) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  CheckInput(observations, fixed_camera, centers->size(), points->size());
  const std::vector<int> body_of_camera =
      BodiesOfCameras(bodies, centers->size());
  GlobalPositioningSummary summary;
  summary.message = WhyNotToSolve(observations, *centers, *points);
  if (!summary.message.empty()) return summary;
  SortByPoints(&observations);
  // Solved about the fixed centre in units of the median distance: neither
  // the place of the world's origin nor its unit then change the damping.
  const std::vector<double> start_log_distances =
      LogDistances(observations, *centers, *points);
  const Eigen::Vector3d origin = (*centers)[fixed_camera];
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const double unit = std::exp(Median(start_log_distances));
  auto unit_centers = Scaled(*centers, origin, 1 / unit, zero);
  auto unit_points = Scaled(*points, origin, 1 / unit, zero);
  const bool has_priors = HasPriors(priors);
  const PointMinimizerSummary found =
      Minimize(observations,
               has_priors ? kNoCamera : fixed_camera,
               options,
               body_of_camera,
               Scaled(priors, origin, unit),
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

  const double world_from_unit =
      bodies.fix_scale || has_priors
          ? unit
          : MedianShrinkage(
                start_log_distances,
                LogDistances(observations, unit_centers, unit_points));
  const auto new_centers = Scaled(unit_centers, zero, world_from_unit, origin);
  const auto new_points = Scaled(unit_points, zero, world_from_unit, origin);
  if (!AllFinite(new_centers) || !AllFinite(new_points)) {
    summary.message = "solution is not finite";
    return summary;
  }
  MoveObserved(
      observations, body_of_camera, new_centers, new_points, centers, points);
  if (!has_priors) (*centers)[fixed_camera] = origin;
  summary.success = true;
  return summary;
}

}  // namespace dgsfm
