#include "estimators/averaging/gravity_refinement.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/check.h"
#include "estimators/option_check.h"
#include "estimators/up_direction.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <ceres/ceres.h>
#include <ceres/rotation.h>

namespace dgsfm {

namespace {

// The standard deviation of gravity is measured again, at most so often, while
// it shrinks by this factor: a bent start deviates more.
constexpr int kMaxNumRounds = 3;
constexpr double kMinShrinkage = 0.8;
// Median length of a vector with two normally distributed components [standard
// deviations].
constexpr double kMedianOfTwo = 1.1774;
constexpr int kMaxNumIterations = 50;
// Pairs that are off cost as much as 1e5 others: the cost hardly changes when
// these do.
constexpr double kFunctionTolerance = 1e-11;

// weight times s^2 r^2 / (s^2 + r^2), GemanMcClureWeight without its bound.
class GemanMcClureLoss : public ceres::LossFunction {
 public:
  GemanMcClureLoss(double scale, double weight)
      : sq_scale_(scale * scale), weight_(weight) {}
  void Evaluate(double sq_norm, double out[3]) const override {
    const double ratio = sq_scale_ / (sq_scale_ + sq_norm);
    out[0] = weight_ * ratio * sq_norm;
    out[1] = weight_ * ratio * ratio;
    out[2] = -2 * out[1] / (sq_scale_ + sq_norm);
  }

 private:
  double sq_scale_;
  double weight_;
};

// log(R_2^T R_21 R_1) / stddev with R_i = start_i exp(step_i).
struct RelativeRotationError {
  // start_2^T R_21 start_1, (w, x, y, z).
  double at_start[4];
  double stddev_rad;

  template <typename T>
  bool operator()(const T* step1, const T* step2, T* residuals) const {
    const T minus_step2[3] = {-step2[0], -step2[1], -step2[2]};
    const T start[4] = {
        T(at_start[0]), T(at_start[1]), T(at_start[2]), T(at_start[3])};
    T first[4], last[4], start_first[4], product[4];
    ceres::AngleAxisToQuaternion(step1, first);
    ceres::AngleAxisToQuaternion(minus_step2, last);
    ceres::QuaternionProduct(start, first, start_first);
    ceres::QuaternionProduct(last, start_first, product);
    ceres::QuaternionToAngleAxis(product, residuals);
    for (int i = 0; i < 3; ++i) residuals[i] /= T(stddev_rad);
    return true;
  }
};

// (exp(step) * down - start^T in_node) / stddev, where down, of unit length, is
// that of the start moved by two steps square to it.
struct GravityError {
  Eigen::Vector3d start_down;
  Eigen::Matrix<double, 3, 2> across;
  Eigen::Vector3d in_world_at_start;
  double stddev_rad;

  template <typename T>
  bool operator()(const T* step, const T* down_step, T* residuals) const {
    using Vector3T = Eigen::Matrix<T, 3, 1>;
    const Vector3T down =
        (start_down.cast<T>() +
         across.cast<T>() * Eigen::Map<const Eigen::Matrix<T, 2, 1>>(down_step))
            .normalized();
    Vector3T turned;
    ceres::AngleAxisRotatePoint(step, down.data(), turned.data());
    Eigen::Map<Vector3T> error(residuals);
    error = (turned - in_world_at_start.cast<T>()) / T(stddev_rad);
    return true;
  }
};

Eigen::Quaterniond AtStart(const RelativeRotation& relative,
                           const std::vector<Eigen::Quaterniond>& rotations) {
  return rotations[relative.node2].conjugate() * relative.cam2_from_cam1 *
         rotations[relative.node1];
}

// Variance of the pairs' residuals in units of those that were given, by the
// pairs within the scale of the loss and the loops that these close.
double VarianceFactor(const std::vector<RelativeRotation>& relatives,
                      double loss_scale,
                      const std::vector<Eigen::Quaterniond>& rotations) {
  double sum = 0;
  int num_loops = 1 - int(rotations.size());
  for (const RelativeRotation& relative : relatives) {
    const double error =
        Eigen::AngleAxisd(AtStart(relative, rotations)).angle() /
        relative.stddev_rad;
    if (error > loss_scale) continue;
    sum += relative.weight * error * error;
    ++num_loops;
  }
  // Without loops, the given standard deviations of pairs hold.
  return num_loops <= 0 ? 1 : sum / (3 * num_loops);
}

// The vertical by gravity, and its deviation about each axis.
std::optional<UpDirection> VerticalOf(
    const std::vector<NodeGravity>& gravities,
    const std::vector<Eigen::Quaterniond>& node_from_world) {
  std::vector<LevelCamera> cameras;
  for (const NodeGravity& gravity : gravities) {
    cameras.push_back({node_from_world[gravity.node], gravity.in_node});
  }
  std::optional<UpDirection> up =
      FindUpDirection(UpDirectionOptions(), cameras);
  if (!up || !up->is_by_gravity) return std::nullopt;
  up->spread_rad /= kMedianOfTwo;
  return up;
}

void AddPairs(const GraphAveragingOptions& averaging,
              const std::vector<RelativeRotation>& relatives,
              const std::vector<Eigen::Quaterniond>& rotations,
              std::vector<Eigen::Vector3d>* steps,
              ceres::Problem* problem) {
  for (const RelativeRotation& relative : relatives) {
    const Eigen::Quaterniond start = AtStart(relative, rotations);
    problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<RelativeRotationError, 3, 3, 3>(
            new RelativeRotationError{
                {start.w(), start.x(), start.y(), start.z()},
                relative.stddev_rad}),
        new GemanMcClureLoss(averaging.loss_scale, relative.weight),
        (*steps)[relative.node1].data(),
        (*steps)[relative.node2].data());
  }
}

// Rotations that minimise the cost from these on; false if the solver fails.
bool Solve(const GraphAveragingOptions& averaging,
           const std::vector<RelativeRotation>& relatives,
           const std::vector<NodeGravity>& gravities,
           const UpDirection& up,
           double gravity_stddev_rad,
           int fixed_node,
           std::vector<Eigen::Quaterniond>* rotations) {
  const double variance_factor =
      VarianceFactor(relatives, averaging.loss_scale, *rotations);
  std::vector<Eigen::Vector3d> steps(rotations->size(),
                                     Eigen::Vector3d::Zero());
  Eigen::Vector2d down_step = Eigen::Vector2d::Zero();
  const Eigen::Quaterniond world_from_up =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), up.in_world);
  ceres::Problem problem;
  AddPairs(averaging, relatives, *rotations, &steps, &problem);
  for (const NodeGravity& gravity : gravities) {
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<GravityError, 3, 3, 2>(new GravityError{
            -up.in_world,
            world_from_up.toRotationMatrix().leftCols<2>(),
            (*rotations)[gravity.node].conjugate() * gravity.in_node,
            gravity_stddev_rad}),
        new GemanMcClureLoss(averaging.loss_scale,
                             gravity.weight * variance_factor),
        steps[gravity.node].data(),
        down_step.data());
  }
  problem.SetParameterBlockConstant(steps[fixed_node].data());
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver_options.max_num_iterations = kMaxNumIterations;
  solver_options.function_tolerance = kFunctionTolerance;
  // Sums of several threads have no fixed order.
  solver_options.num_threads = 1;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return false;
  for (size_t i = 0; i < steps.size(); ++i) {
    const double angle = steps[i].norm();
    if (angle == 0) continue;
    (*rotations)[i] =
        ((*rotations)[i] * Eigen::Quaterniond(Eigen::AngleAxisd(
                               angle, Eigen::Vector3d(steps[i] / angle))))
            .normalized();
  }
  return true;
}

}  // namespace

bool GravityRefinementOptions::IsValid(std::string* error) const {
  return OptionBounds(error).Above("gravity_stddev", stddev_deg, 0).AreKept();
}

bool RefineByGravity(const GravityRefinementOptions& options,
                     const GraphAveragingOptions& averaging,
                     const std::vector<RelativeRotation>& relative_rotations,
                     const std::vector<NodeGravity>& gravities,
                     int fixed_node,
                     std::vector<Eigen::Quaterniond>* node_from_world) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  std::vector<Eigen::Quaterniond> rotations = *node_from_world;
  double last_stddev_rad = 0;
  for (int round = 0; round < kMaxNumRounds; ++round) {
    ThrowIfCancelled();
    const std::optional<UpDirection> up = VerticalOf(gravities, rotations);
    if (!up) return false;
    const double stddev_rad =
        std::max(options.stddev_deg * M_PI / 180, up->spread_rad);
    if (round > 0 && stddev_rad > kMinShrinkage * last_stddev_rad) break;
    last_stddev_rad = stddev_rad;
    if (!Solve(averaging,
               relative_rotations,
               gravities,
               *up,
               stddev_rad,
               fixed_node,
               &rotations)) {
      return false;
    }
  }
  *node_from_world = std::move(rotations);
  return true;
}

}  // namespace dgsfm
