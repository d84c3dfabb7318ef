// The cost of a TwoViewModel over the matches of a pair, and its Gauss-Newton
// approximation.

#pragma once

#include "colmap_ext/focal_prior.h"
#include "estimators/two_view/two_view_data.h"
#include "estimators/two_view/two_view_depth_field.h"
#include "estimators/two_view/two_view_model.h"
#include "estimators/two_view/two_view_sums.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

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
  // max_reprojection_error_px [RePoseD]. Points behind the cameras cost
  // nothing.
  REPROJECTION,
};

// Sum over matches, of
//   rho(Sampson error / stddev_px) + depth term + focal and field priors,
// each residual truncated by itself, so that a wrong depth does not cost the
// match its epipolar information. Points behind the cameras pay the full
// truncation.
// Fields without a default depend on the pair: see TwoViewProblem::CostOptions.
struct TwoViewCostOptions {
  DepthTerm depth_term = DepthTerm::WHITENED;
  // Noise of an image point [px].
  double stddev_px;
  // Noise of log depth, each map [1].
  double log_depth_stddev = 0.1;
  // Truncation of the Sampson error [px] and of the whitened depth term [1].
  double max_epipolar_error_px;
  double max_depth_residual = 3;
  // Truncation of the transfer error in DepthTerm::REPROJECTION [px], at
  // which it costs as much as a Sampson error of max_epipolar_error_px.
  double max_reprojection_error_px;
  TwoViewLoss loss = TwoViewLoss::TRUNCATED_SQUARES;
  FocalPrior focal_prior1;
  FocalPrior focal_prior2;
  // Standard deviation of each coefficient of the smooth depth errors [1], 0 =
  // no such errors; with DepthTerm::WHITENED only.
  double depth_field_stddev = 0;
  // Lengths in which they are about one over the image [px].
  double depth_field_unit1_px;
  double depth_field_unit2_px;
};

struct TwoViewCost {
  double epipolar = 0;
  double depth = 0;
  double prior = 0;
  // Matches whose depth term is not truncated.
  int num_depth_inliers = 0;

  double Total() const { return epipolar + depth + prior; }
};

struct NormalEquations {
  Eigen::Matrix<double, kNumCostParams, kNumCostParams> matrix;
  Eigen::Matrix<double, kNumCostParams, 1> gradient;
};

// Keeps a reference to the options.
class TwoViewCostFunction {
 public:
  TwoViewCostFunction(const TwoViewData& data,
                      const TwoViewCostOptions& options);

  // Cost at `model`, and its normal equations. Whitens the depth term at this
  // model, also for the following calls of Evaluate.
  TwoViewCost Linearize(const TwoViewModel& model,
                        const DepthFields& fields,
                        NormalEquations* normal);
  TwoViewCost Evaluate(const TwoViewModel& model, const DepthFields& fields);

  // The whitened depth term alone, whitened at this model.
  TwoViewCost EvaluateDepth(const TwoViewModel& model);

  bool HasFields() const { return options_.depth_field_stddev > 0; }

 private:
  TwoViewCost Sum(const TwoViewModel& model,
                  const DepthFields& fields,
                  NormalEquations* normal);
  void AddEpipolar(const TwoViewModel& model,
                   TwoViewCost* cost,
                   NormalEquations* normal) const;
  // With `whiten`, whitens the residuals at this model first.
  template <int kSize>
  void AddWhitened(const TwoViewModel& model,
                   const DepthFields& fields,
                   bool whiten,
                   TwoViewCost* cost,
                   NormalEquations* normal);
  void AddReprojection(const TwoViewModel& model,
                       TwoViewCost* cost,
                       NormalEquations* normal) const;
  void AddPriors(const TwoViewModel& model,
                 const DepthFields& fields,
                 TwoViewCost* cost,
                 NormalEquations* normal) const;

  const TwoViewCostOptions& options_;
  const std::vector<MatchLanes> matches_;
  // The matches seen from image 2, for DepthTerm::REPROJECTION.
  std::vector<MatchLanes> swapped_matches_;
  TwoViewLossOptions epipolar_loss_, depth_loss_;
  WhiteningOptions whitening_ = {};
  std::vector<WhiteningLanes> whitenings_;
};

}  // namespace dgsfm
