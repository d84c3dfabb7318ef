#include "estimators/two_view/two_view_degeneracy.h"

#include "estimators/two_view/two_view_lanes.h"

#include <array>
#include <numeric>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>

namespace dgsfm {
namespace {

constexpr double kMinShare = 0.8;
constexpr int kNumRefinements = 3;

// Indices of the matches with |H x1 - x2| below the bound.
std::vector<int> FittingMatches(const TwoViewData& data,
                                const Eigen::Matrix3d& H,
                                double max_error_px) {
  std::vector<int> fitting;
  for (size_t i = 0; i < data.size(); ++i) {
    const Eigen::Vector3d point = H * data[i].x1.homogeneous();
    // Multiplied by the third coordinate, whose sign is free.
    const Eigen::Vector2d error = point.head<2>() - point.z() * data[i].x2;
    if (error.squaredNorm() <
        max_error_px * max_error_px * point.z() * point.z()) {
      fitting.push_back(static_cast<int>(i));
    }
  }
  return fitting;
}

bool IsMost(size_t num_fitting, const TwoViewData& data) {
  return !data.empty() &&
         static_cast<double>(num_fitting) >= kMinShare * data.size();
}

bool IsMost(const std::vector<int>& fitting, const TwoViewData& data) {
  return IsMost(fitting.size(), data);
}

// Number of matches with |H x1 - x2| below the bound, as FittingMatches has
// them.
DGSFM_TARGET_CLONES
int CountFitting(const std::vector<MatchLanes>& matches,
                 const Eigen::Matrix3d& H,
                 double max_error_px) {
  const double* h = H.data();
  const double max_sq_error = max_error_px * max_error_px;
  Lanes num_fitting = {};
  for (const MatchLanes& match : matches) {
    Lanes point[3];
    for (int k = 0; k < 3; ++k) {
      point[k] = h[k] * match.x1[0] + h[3 + k] * match.x1[1] + h[6 + k];
    }
    const Lanes x_error = point[0] - point[2] * match.x2[0];
    const Lanes y_error = point[1] - point[2] * match.x2[1];
    num_fitting += x_error * x_error + y_error * y_error <
                           max_sq_error * point[2] * point[2]
                       ? match.is_match
                       : Lanes{};
  }
  return static_cast<int>(Sum(num_fitting));
}

// Maps the four unit vectors e1, e2, e3, (1, 1, 1) to the points.
Eigen::Matrix3d ProjectiveBasis(const std::array<Eigen::Vector2d, 4>& points) {
  Eigen::Matrix3d basis;
  for (int k = 0; k < 3; ++k) basis.col(k) = points[k].homogeneous();
  const Eigen::Vector3d weights = basis.inverse() * points[3].homogeneous();
  return basis * weights.asDiagonal();
}

// Least squares of the transfer errors times the third coordinate, which the
// start fixes [px].
Eigen::Matrix3d RefineHomography(const TwoViewData& data,
                                 const std::vector<int>& indices,
                                 const Eigen::Matrix3d& start) {
  using Matrix8 = Eigen::Matrix<double, 8, 8>;
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  Matrix8 matrix = Matrix8::Zero();
  Vector8 right = Vector8::Zero();
  for (const int i : indices) {
    const Eigen::Vector2d& x1 = data[i].x1;
    const Eigen::Vector2d& x2 = data[i].x2;
    const double weight = 1 / (start.row(2) * x1.homogeneous()).value();
    for (int k = 0; k < 2; ++k) {
      Vector8 row = Vector8::Zero();
      row.segment<3>(3 * k) = weight * x1.homogeneous();
      row.tail<2>() = -weight * x2(k) * x1;
      matrix += row * row.transpose();
      right += weight * x2(k) * row;
    }
  }
  const Vector8 h = matrix.ldlt().solve(right);
  Eigen::Matrix3d H;
  H << h(0), h(1), h(2), h(3), h(4), h(5), h(6), h(7), 1;
  return H;
}

// The rotation between the viewing rays of these matches, by least squares.
Eigen::Matrix3d FitRotation(const TwoViewData& data,
                            const std::vector<int>& indices,
                            const TwoViewModel& model) {
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (const int i : indices) {
    correlation +=
        (data[i].x2 / model.focal2).homogeneous().normalized() *
        (data[i].x1 / model.focal1).homogeneous().normalized().transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
      correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d U = svd.matrixU();
  if ((U * svd.matrixV().transpose()).determinant() < 0) U.col(2) *= -1;
  return U * svd.matrixV().transpose();
}

}  // namespace

bool IsPlanar(const TwoViewData& inliers,
              double max_error_px,
              SplitMix64* random) {
  constexpr int kNumTrials = 100;
  if (inliers.size() < kMinNumInliers) return false;
  const std::vector<MatchLanes> matches = CreateMatchLanes(inliers);
  int best_num_fitting = 0;
  Eigen::Matrix3d best_H = Eigen::Matrix3d::Identity();
  for (int trial = 0; trial < kNumTrials && !IsMost(best_num_fitting, inliers);
       ++trial) {
    std::array<Eigen::Vector2d, 4> points1, points2;
    for (int k = 0; k < 4; ++k) {
      const int i = random->Below(static_cast<int>(inliers.size()));
      points1[k] = inliers[i].x1;
      points2[k] = inliers[i].x2;
    }
    // Repeated matches make it singular, and nothing fits.
    const Eigen::Matrix3d H =
        ProjectiveBasis(points2) * ProjectiveBasis(points1).inverse();
    const int num_fitting = CountFitting(matches, H, max_error_px);
    if (num_fitting <= best_num_fitting) continue;
    best_num_fitting = num_fitting;
    best_H = H;
  }
  std::vector<int> best = FittingMatches(inliers, best_H, max_error_px);
  for (int k = 0; k < kNumRefinements && best.size() >= kMinNumInliers; ++k) {
    if (IsMost(best, inliers)) return true;
    best_H /= best_H(2, 2);
    best_H = RefineHomography(inliers, best, best_H);
    best = FittingMatches(inliers, best_H, max_error_px);
  }
  return IsMost(best, inliers);
}

bool IsRotationOnly(const TwoViewData& inliers,
                    const TwoViewModel& model,
                    double max_error_px) {
  // The model's own rotation makes up for its translation, so that the start is
  // the rotation of all matches.
  std::vector<int> fitting(inliers.size());
  std::iota(fitting.begin(), fitting.end(), 0);
  for (int k = 0; k < kNumRefinements; ++k) {
    const Eigen::Matrix3d H =
        Eigen::Vector3d(model.focal2, model.focal2, 1).asDiagonal() *
        FitRotation(inliers, fitting, model) *
        Eigen::Vector3d(1 / model.focal1, 1 / model.focal1, 1).asDiagonal();
    fitting = FittingMatches(inliers, H, max_error_px);
  }
  return IsMost(fitting, inliers);
}

bool IsStationary(const TwoViewData& inliers, double max_error_px) {
  return IsMost(
      FittingMatches(inliers, Eigen::Matrix3d::Identity(), max_error_px),
      inliers);
}

}  // namespace dgsfm
