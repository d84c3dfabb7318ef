// The matches of an image pair as the two-view estimators work on them.

#pragma once

#include "estimators/two_view/two_view_residuals.h"

#include <colmap/util/alignment.h>

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct TwoViewMatch {
  Eigen::Vector2d x1 = Eigen::Vector2d::Zero();
  Eigen::Vector2d x2 = Eigen::Vector2d::Zero();
  // Both zero if one is unknown.
  double depth1 = 0;
  double depth2 = 0;
  PointCovariance covariance1 = UnitPointCovariance();
  PointCovariance covariance2 = UnitPointCovariance();

  bool HasDepths() const { return depth1 > 0; }

  double Sampson(const Eigen::Matrix3d& F) const {
    return SampsonError(F, x1, x2, covariance1, covariance2);
  }

  bool Forward(const TwoViewModel& model, Transfer* transfer) const {
    return TransferMatch(model, x1, depth1, x2, depth2, transfer);
  }

  // The same match seen from image 2.
  TwoViewMatch Swapped() const {
    return {x2, x1, depth2, depth1, covariance2, covariance1};
  }
};

// In the order in which they are scored.
using TwoViewData = std::vector<TwoViewMatch>;

inline TwoViewData Subset(const TwoViewData& data,
                          const std::vector<int>& indices) {
  TwoViewData subset;
  subset.reserve(indices.size());
  for (const int i : indices) subset.push_back(data[i]);
  return subset;
}

}  // namespace dgsfm
