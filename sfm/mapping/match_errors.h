// Errors of matches by the poses of a model.

#pragma once

#include "estimators/two_view/two_view_residuals.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>
#include <colmap/feature/types.h>

#include <limits>
#include <map>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// A key point without distortion, and its covariance for unit noise in its
// image. Not a number where UndistortPoint() has nothing, so that no epipolar
// line is near.
struct UndistortedKeypoint {
  Eigen::Vector2d point =
      Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
  PointCovariance covariance = UnitPointCovariance();
};

using UndistortedKeypoints = std::vector<UndistortedKeypoint>;

// Key points of each registered image. The same for any number of threads.
std::map<colmap::image_t, UndistortedKeypoints> UndistortKeypoints(
    const colmap::Reconstruction& model, int num_threads);

// How far matches are off the poses of two images.
class MatchErrors {
 public:
  MatchErrors(const colmap::Reconstruction& model,
              const colmap::Image& image1,
              const colmap::Image& image2);

  // Sampson error [px], of the epipolar line or of the turned key point.
  double operator()(const UndistortedKeypoint& keypoint1,
                    const UndistortedKeypoint& keypoint2) const;

 private:
  Eigen::Matrix3d F_;
  Eigen::Matrix3d H_;
  bool only_turns_ = false;
};

// Matches whose error under the poses of the model is small, each feature at
// most once, as COLMAP's correspondence graph wants them.
colmap::FeatureMatches MatchesOfPoses(const MatchErrors& error_px,
                                      const UndistortedKeypoints& keypoints1,
                                      const UndistortedKeypoints& keypoints2,
                                      const colmap::FeatureMatches& matches,
                                      double max_error_px);

}  // namespace dgsfm
