// The matches of an image pair as the two-view estimators work on them.

#pragma once

#include "estimators/two_view/two_view_residuals.h"

#include <colmap/util/alignment.h>

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// In the order in which they are scored; depth 0 = unknown.
struct TwoViewData {
  std::vector<Eigen::Vector2d> points1;
  std::vector<Eigen::Vector2d> points2;
  std::vector<double> depths1;
  std::vector<double> depths2;
  // Covariances of the points; empty = unit covariance.
  std::vector<PointCovariance> covariances1;
  std::vector<PointCovariance> covariances2;

  int Size() const { return static_cast<int>(points1.size()); }
  bool HasDepths(int i) const { return depths1[i] > 0 && depths2[i] > 0; }

  PointCovariance Covariance1(int i) const {
    return covariances1.empty() ? UnitPointCovariance() : covariances1[i];
  }
  PointCovariance Covariance2(int i) const {
    return covariances2.empty() ? UnitPointCovariance() : covariances2[i];
  }

  // Sum of the variances of the two points of a match per coordinate, in the
  // mean over all directions.
  double Variance(int i) const {
    if (covariances1.empty()) return 2;
    return 0.5 * (covariances1[i](0) + covariances1[i](2) + covariances2[i](0) +
                  covariances2[i](2));
  }

  double Sampson(const Eigen::Matrix3d& F,
                 int i,
                 Eigen::Matrix3d* gradient = nullptr) const {
    return SampsonError(
        F, points1[i], points2[i], Covariance1(i), Covariance2(i), gradient);
  }

  bool Forward(const TwoViewModel& model, int i, Transfer* transfer) const {
    return TransferMatch(TransferDirection::FORWARD,
                         model,
                         points1[i],
                         depths1[i],
                         points2[i],
                         depths2[i],
                         transfer);
  }

  // The matches with these indices.
  TwoViewData Subset(const std::vector<int>& indices) const;
};

}  // namespace dgsfm
