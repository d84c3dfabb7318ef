// Bundle adjustment over plain arrays.

#pragma once

#include "colmap_ext/rigid3.h"
#include "estimators/optimization/point_minimizer.h"

#include <array>
#include <vector>

#include <Eigen/Core>
#include <ceres/problem.h>

namespace dgsfm {

struct BundleCamera {
  // COLMAP's model and parameters.
  int model_id = 0;
  std::vector<double> params;
  // Those that are refined, by index.
  std::vector<int> refined_params;
};

// Cameras that move together.
struct BundleFrame {
  Rigid3d rig_from_world;
  // Components of rotation vector and translation that are held.
  std::array<bool, 6> is_constant = {};
};

// The pose of a camera in its rig.
struct BundleSensor {
  Rigid3d cam_from_rig;
  bool is_refined = false;
};

struct BundleImage {
  // Of an image of a frame: what the poses of frame and sensor make of it.
  Rigid3d cam_from_world;
  int camera = 0;
  // Its frame and its sensor; -1 if it moves by itself.
  int frame = -1;
  int sensor = -1;
  // Components of rotation vector and translation that are held.
  std::array<bool, 6> is_constant = {};
  // Standard deviation of the logarithm of its prior depths [1] and weight of a
  // deviation by it [px]; a weight of 0 leaves them out.
  double depth_stddev = 1;
  double depth_weight_px = 0;
  // Logarithm of the factor of its prior depths, refined with them.
  double log_depth_scale = 0;
};

struct BundleObservation {
  int image = 0;
  int point = 0;
  Eigen::Vector2d xy_px = Eigen::Vector2d::Zero();
  // Prior depth along the optical axis, up to the factor of its image; 0
  // unknown.
  double prior_depth = 0;
};

struct Bundle {
  std::vector<BundleCamera> cameras;
  std::vector<BundleImage> images;
  std::vector<BundleFrame> frames;
  std::vector<BundleSensor> sensors;
  std::vector<Eigen::Vector3d> points;
  // In any order.
  std::vector<BundleObservation> observations;
};

// Minimises sum_k rho(|x_k - pi(P_k X_k)|^2) / 2 over the poses, points and
// refined parameters of a bundle, with the soft L1 loss
// rho(s) = 2 a^2 (sqrt(1 + s / a^2) - 1) of scale a = loss_scale_px [px]. Poses
// move by cam_from_world = (exp(w) R, t + dt). Images of a frame have
// cam_from_world = cam_from_rig * rig_from_world, of which the second pose, and
// the first where it is refined, move in that way instead.
//
// Prior depths D add w_i^2 rho(e^2) / 2 with e = (log z - log D - s_i) /
// sigma_i, the Cauchy loss rho(e^2) = b^2 log(1 + e^2 / b^2) of scale b = 2,
// and log scales s_i of the images, which are minimised over too.
//
// `camera_terms`, if not null, adds its residuals. Its parameter blocks are the
// `params` of cameras of the bundle, as whole vectors, and others of its own,
// without manifolds and not constant, which are minimised too.
//
// Not successful, the bundle unchanged, if points lie in the plane of a camera
// centre or a start is not finite. Throws on indices out of range. The same
// for any number of threads.
PointMinimizerSummary SolveBundle(const PointMinimizerOptions& options,
                                  double loss_scale_px,
                                  ceres::Problem* camera_terms,
                                  Bundle* bundle);

}  // namespace dgsfm
