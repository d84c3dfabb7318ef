// How well a TwoViewModel or a fundamental matrix fits the matches of a pair:
// truncated Sampson errors and points in front of the cameras.

#pragma once

#include "estimators/two_view/two_view_data.h"
#include "estimators/two_view/two_view_model.h"

#include <limits>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

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

// Scores thousands of models on the same matches: single precision, several
// matches at a time. Keeps a reference to the data.
class TwoViewScorer {
 public:
  TwoViewScorer(const TwoViewData& data, double max_error_px);

  // Scores stop (with an infinite cost) once `max_cost` is exceeded.
  TwoViewScore Score(
      const TwoViewModel& model,
      double max_cost = std::numeric_limits<double>::infinity()) const;
  // Without the test for points behind the cameras.
  TwoViewScore Score(
      const Eigen::Matrix3d& F,
      double max_cost = std::numeric_limits<double>::infinity()) const;
  // The first `max_num` matches with a Sampson error below `max_error_px`.
  std::vector<int> Near(const Eigen::Matrix3d& F,
                        double max_error_px,
                        int max_num) const;

 private:
  static constexpr int kBlock = 16;
  using Values = Eigen::Array<float, kBlock, 1>;

  // Squared Sampson errors of the matches of a block.
  Values SqErrors(const Eigen::Matrix3f& F, int begin) const;
  int NumMatches() const { return static_cast<int>(data_.size()); }

  const TwoViewData& data_;
  const double max_error_px_;
  bool has_unit_covariances_ = true;
  // Padded to whole blocks.
  Eigen::ArrayXf x1_, y1_, x2_, y2_;
  Eigen::ArrayX3f covariances1_, covariances2_;
};

}  // namespace dgsfm
