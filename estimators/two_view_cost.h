// The cost of a TwoViewModel over all matches of a pair, how models are
// scored, and how they are refined.

#pragma once

#include "estimators/two_view_geometry_depth.h"
#include "estimators/two_view_model.h"
#include "estimators/two_view_residuals.h"

#include <limits>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Matches in the order in which they are scored; depth 0 = unknown.
struct TwoViewData {
  std::vector<Eigen::Vector2d> points1;
  std::vector<Eigen::Vector2d> points2;
  std::vector<double> depths1;
  std::vector<double> depths2;

  int Size() const { return static_cast<int>(points1.size()); }
  bool HasDepths(int i) const { return depths1[i] > 0 && depths2[i] > 0; }
};

struct TwoViewScore {
  // Sum of min(Sampson error^2, max_error^2) [px^2]; a match that is not in
  // front of both cameras costs max_error^2.
  double cost = std::numeric_limits<double>::infinity();
  int num_inliers = 0;
};

// Whether the two viewing rays of a match meet in front of both cameras. Rays
// that are parallel within `max_error_px` count as meeting at infinity, so
// that noise does not turn far points into outliers.
class Cheirality {
 public:
  Cheirality(const TwoViewModel& model, double max_error_px);
  bool operator()(const Eigen::Vector2d& x1, const Eigen::Vector2d& x2) const;

 private:
  Eigen::Matrix3d ray1_in_cam2_;  // of (x1, 1)
  Eigen::Vector3d translation_;
  double inverse_focal2_;
  double max_sq_sine_;
};

// Scores stop (with an infinite cost) once `max_cost` is exceeded.
TwoViewScore ScoreModel(const TwoViewData& data,
                        const TwoViewModel& model,
                        double max_error_px,
                        double max_cost);
// Without the test for points behind the cameras.
TwoViewScore ScoreFundamentalMatrix(const TwoViewData& data,
                                    const Eigen::Matrix3d& F,
                                    double max_error_px,
                                    double max_cost);

// What the depths add to the cost.
enum class DepthTerm {
  // Nothing; the translation keeps its length.
  NONE,
  // One residual of size 2 per match with depths: the part of the forward
  // transfer error along the epipolar line, and the log ratio of the depths.
  // Whitened by their covariance under pixel and log-depth noise: with j the
  // derivative of the transfer by the log depth and a that of the log of the
  // transferred depth,
  //   [2 px^2 + |j|^2 sd^2, |j| a sd^2; ., (1 + a^2) sd^2].
  // Parallax decides by itself whether a point tells of rotation or scale.
  WHITENED,
  // Forward and backward transfer error, two residuals of size 2, divided by
  // max_reprojection_error_px [RePoseD].
  REPROJECTION,
};

// Sum over matches, of
//   rho(Sampson error / stddev_px) + depth term + focal prior,
// each residual truncated by itself, so that a wrong depth does not cost the
// match its epipolar information. Points behind the cameras pay the full
// truncation.
struct TwoViewCostOptions {
  DepthTerm depth_term = DepthTerm::WHITENED;
  // Noise of an image point [px].
  double stddev_px = 0.5;
  // Noise of log depth, each map [1].
  double log_depth_stddev = 0.1;
  // Truncation of the Sampson error [px] and of the whitened depth term [1].
  double max_epipolar_error_px = 1;
  double max_depth_residual = 3;
  // Truncation of the transfer error in DepthTerm::REPROJECTION [px], at
  // which it costs as much as a Sampson error of max_epipolar_error_px.
  double max_reprojection_error_px = 16;
  // Only so many of the first matches take part.
  int max_num_matches = std::numeric_limits<int>::max();
  // Cauchy's loss up to the truncation instead of squares.
  bool cauchy = false;
  // Refinement stops when a step lowers the cost by a smaller share.
  double min_relative_decrease = 1e-5;
  // Gaussian prior on unknown log focal lengths; stddev 0 = none.
  double log_focal_prior_stddev = 0;
  double focal_prior1_px = 1;
  double focal_prior2_px = 1;
};

struct TwoViewCost {
  double epipolar = 0;
  double depth = 0;
  double prior = 0;
  // Matches whose depth term is not truncated.
  int num_depth_inliers = 0;

  double Total() const { return epipolar + depth + prior; }
};

TwoViewCost EvaluateCost(const TwoViewData& data,
                         const TwoViewModel& model,
                         const TwoViewCostOptions& options);

using TwoViewMatrix =
    Eigen::Matrix<double, kNumTwoViewParams, kNumTwoViewParams>;

// Levenberg-Marquardt over the parameters that are unknown in `focal_case`.
// Whitening follows the model from step to step. Returns the cost of the
// result, never above that of the start. A model or step that is not finite
// leaves the model as it was.
TwoViewCost RefineModel(const TwoViewData& data,
                        FocalCase focal_case,
                        const TwoViewCostOptions& options,
                        int max_num_iterations,
                        TwoViewModel* model);

// Inverse of the Gauss-Newton matrix without prior: zero in the rows of known
// parameters, huge on the diagonal where nothing is known. With a shared
// focal length both its rows hold the same values.
TwoViewMatrix EstimateCovariance(const TwoViewData& data,
                                 FocalCase focal_case,
                                 const TwoViewCostOptions& options,
                                 const TwoViewModel& model);

}  // namespace dgsfm
