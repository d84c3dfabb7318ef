// How well a TwoViewModel or a fundamental matrix fits the matches of a pair:
// truncated Sampson errors and points in front of the cameras.

#pragma once

#include "estimators/lanes.h"
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
template <typename Scalar>
class BasicCheirality {
 public:
  BasicCheirality(const TwoViewModel& model, double max_error_px);

  bool operator()(const Eigen::Vector2d& x1, const Eigen::Vector2d& x2) const {
    return IsInFront(x1.data(), x2.data()) > 0;
  }

  // 1 if the rays meet, else 0, for one match or for several in lanes.
  template <typename Number>
  DGSFM_INLINE Number IsInFront(const Number* x1, const Number* x2) const {
    const Scalar* R = ray1_in_cam2_.data();
    const Number zero = x1[0] - x1[0];
    const Number one = zero + Scalar(1);
    Number p[3];
    for (int k = 0; k < 3; ++k) {
      p[k] = R[k] * x1[0] + R[3 + k] * x1[1] + R[6 + k];
    }
    const Number q[3] = {inverse_focal2_ * x2[0], inverse_focal2_ * x2[1], one};
    const Number t[3] = {
        zero + translation_[0], zero + translation_[1], zero + translation_[2]};
    Number normal[3], qt[3], pt[3];
    Cross(p, q, normal);
    Cross(q, t, qt);
    Cross(p, t, pt);
    // Both depths of z1 p + t = z2 q in the least-squares sense, times the
    // squared norm of the normal.
    const Number meets =
        Dot(normal, qt) > 0 ? Dot(normal, pt) > 0 ? one : zero : zero;
    const Number is_parallel =
        Dot(p, q) > 0
            ? Dot(normal, normal) < max_sq_sine_ * Dot(p, p) * Dot(q, q) ? one
                                                                         : zero
            : zero;
    return meets > is_parallel ? meets : is_parallel;
  }

 private:
  template <typename Number>
  static DGSFM_INLINE Number Dot(const Number* a, const Number* b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  }

  template <typename Number>
  static DGSFM_INLINE void Cross(const Number* a,
                                 const Number* b,
                                 Number* product) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
  }

  Eigen::Matrix<Scalar, 3, 3> ray1_in_cam2_;  // of (x1, 1)
  Eigen::Matrix<Scalar, 3, 1> translation_;
  Scalar inverse_focal2_;
  Scalar max_sq_sine_;
};

using Cheirality = BasicCheirality<double>;

// Scores thousands of models on the same matches: single precision, several
// matches at a time.
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
  // The first `max_num` of the matches that Score counts.
  std::vector<int> Inliers(const TwoViewModel& model, int max_num) const;

 private:
  struct Group {
    FloatLanes x1[2], x2[2];
    FloatLanes covariance1[3], covariance2[3];
    // 1 or 0; the last lanes of a pair may hold no match.
    FloatLanes is_match;
  };

  // 1 for matches within `max_sq_error` in front of both cameras, else 0.
  static FloatLanes AreInliers(const BasicCheirality<float>& cheirality,
                               const FloatLanes& sq_errors,
                               float max_sq_error,
                               const Group& group);
  // Squared Sampson errors of a group of matches; F column-major.
  static FloatLanes SqErrors(const float* F, const Group& group);

  const double max_error_px_;
  std::vector<Group> groups_;
};

}  // namespace dgsfm
