// Camera centres and points from rotations and viewing rays, from a metric
// start (DGSfM Eq. 17; BATA residual of Zhuang 2018 as in GLOMAP).

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct PositioningObservation {
  int camera = 0;
  int point = 0;
  // Unit viewing ray in the world frame: R_i^T u.
  Eigen::Vector3d ray_in_world = Eigen::Vector3d::UnitZ();
  // Weight of the squared residual [1].
  double weight = 1;
};

struct GlobalPositioningOptions {
  int max_num_iterations = 100;
  // Huber threshold on the norm of the residual, the sine of the angle
  // between ray and point direction [1].
  double loss_scale = 0.1;
  // Relative decrease of the cost at which the solver stops [1].
  double function_tolerance = 1e-5;
  int num_threads = 1;

  bool IsValid(std::string* error) const;
};

struct GlobalPositioningSummary {
  // Whether centres and points are finite and no worse than at the start.
  bool success = false;
  // Whether it ended before max_num_iterations did.
  bool converged = false;
  int num_iterations = 0;
  double initial_cost = 0;
  double final_cost = 0;
  std::string message;
};

// Cameras that move together, with the offsets between their centres in the
// start; by camera, or empty: each moves by itself.
struct PositioningBodies {
  std::vector<int> body_of_camera;
  // Whether these offsets fix the scale, which is free otherwise.
  bool fix_scale = false;
};

// Minimises sum w rho(min_alpha |d - alpha (X - c)|^2), alpha >= 0, over the
// centres c and points X: the scale alpha of each observation is eliminated
// in closed form (see estimators/optimization/ray_point_residual.h). Points
// behind a camera do not feel its ray.
//
// Gauge: centre of fixed_camera constant; the scale is held by the start's
// damping and restored afterwards: a scaling about the fixed centre makes the
// median over the observations of log(distance / distance in the start) zero.
// Bodies that fix the scale leave no scale to restore; the offsets of others
// are zero.
// Cameras and points without observations stay where they are.
//
// Not successful, centres and points unchanged, without observations or if the
// start is not finite; running out of iterations is not a failure. Throws on
// indices out of range, rays that are not unit vectors and weights that are not
// finite and positive.
//
// The same for any number of threads.
GlobalPositioningSummary SolveGlobalPositioning(
    const std::vector<PositioningObservation>& observations,
    int fixed_camera,
    const GlobalPositioningOptions& options,
    std::vector<Eigen::Vector3d>* centers,
    std::vector<Eigen::Vector3d>* points,
    const PositioningBodies& bodies = {});

}  // namespace dgsfm
