// Bundle adjustment over plain arrays.

#pragma once

#include "colmap_ext/rigid3.h"
#include "estimators/optimization/center_prior.h"
#include "estimators/optimization/point_minimizer.h"
#include "estimators/optimization/robust_loss.h"

#include <array>
#include <limits>
#include <vector>

#include <Eigen/Core>

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
  // Components of rotation vector and shift that are held, see SolveBundle.
  std::array<bool, 6> is_constant = {};
};

// The pose of a camera in its rig.
struct BundleSensor {
  Rigid3d cam_from_rig;
  bool is_refined = false;
};

struct BundleImage {
  // For an image of a frame, what the poses of frame and sensor make of it.
  Rigid3d cam_from_world;
  int camera = 0;
  // Its frame and its sensor; -1 if it moves by itself.
  int frame = -1;
  int sensor = -1;
  // Components of rotation vector and shift that are held, see SolveBundle.
  std::array<bool, 6> is_constant = {};
};

struct BundleObservation {
  int image = 0;
  int point = 0;
  Eigen::Vector2d xy_px = Eigen::Vector2d::Zero();
};

// Prior of some parameters of a camera, one robust term of the cost.
struct BundlePrior {
  int camera = 0;
  struct Parameter {
    int index = 0;
    double mean = 0;
    // Standard deviation over that of key points [1 / px].
    double stddev_per_px = 1;
  };
  std::vector<Parameter> parameters;
  // Scale of the Cauchy loss [px]; infinite = no loss.
  double loss_scale_px = std::numeric_limits<double>::infinity();
};

struct Bundle {
  std::vector<BundleCamera> cameras;
  std::vector<BundlePrior> priors;
  std::vector<BundleImage> images;
  std::vector<BundleFrame> frames;
  std::vector<BundleSensor> sensors;
  std::vector<Eigen::Vector3d> points;
  // In any order.
  std::vector<BundleObservation> observations;
  // Priors of the centres of all images, in their order, or empty.
  std::vector<CenterPrior> center_priors;
  // What they count [px].
  CenterPriorWeight center_prior_weight;
  // Whether steps are curved, see estimators/optimization/curved_step.h, where
  // one pose is held and at most one component of d of another; that component
  // of the translation itself stays then.
  bool curved_steps = false;
};

// Minimises sum_k rho(|x_k - pi(P_k X_k)|^2) / 2 over the poses, points and
// refined parameters of a bundle, with a loss rho of errors in px. Poses move
// by cam_from_world = (exp(w) R, exp(w) (t - p) + p + d), with p = t, or p = 0
// where steps are curved: they turn about the origin of the world or about
// their centres. Images of a frame have cam_from_world = cam_from_rig *
// rig_from_world, of which the second pose, and the first where it is refined,
// move in that way instead. Held components are those of w and d.
//
// Each prior adds rho(sum_i ((p_i - mean_i) / stddev_per_px_i)^2) / 2 with the
// Cauchy loss of its scale. Prior centres add their costs, see
// estimators/optimization/center_prior.h.
//
// Not successful, the bundle unchanged, if points lie in the plane of a camera
// centre or a start is not finite. Throws on indices out of range. The same
// for any number of threads.
PointMinimizerSummary SolveBundle(const PointMinimizerOptions& options,
                                  const RobustLoss& loss,
                                  Bundle* bundle);

}  // namespace dgsfm
