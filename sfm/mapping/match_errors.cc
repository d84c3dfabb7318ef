#include "sfm/mapping/match_errors.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/two_view/two_view_model.h"
#include "sfm/mapping/model_access.h"
#include "sfm/verification/centered_point.h"

#include <cmath>
#include <utility>

namespace dgsfm {

std::map<colmap::image_t, UndistortedKeypoints> UndistortKeypoints(
    const colmap::Reconstruction& model, int num_threads) {
  const std::vector<colmap::image_t> image_ids = SortedRegisteredImages(model);
  std::vector<UndistortedKeypoints> keypoints(image_ids.size());
  ParallelFor(image_ids.size(), num_threads, [&](size_t i) {
    const colmap::Image& image = model.Image(image_ids[i]);
    const colmap::Camera& camera = model.Camera(image.CameraId());
    for (const colmap::Point2D& point2D : image.Points2D()) {
      UndistortedKeypoint& keypoint = keypoints[i].emplace_back();
      const auto undistorted = UndistortPoint(camera, point2D.XY());
      if (!undistorted) continue;
      keypoint.point = undistorted->point;
      keypoint.covariance = UndistortedCovariance(undistorted->pixel_jacobian);
    }
  });
  std::map<colmap::image_t, UndistortedKeypoints> keypoints_of_images;
  for (size_t i = 0; i < image_ids.size(); ++i) {
    keypoints_of_images.emplace_hint(
        keypoints_of_images.end(), image_ids[i], std::move(keypoints[i]));
  }
  return keypoints_of_images;
}

MatchErrors::MatchErrors(const colmap::Reconstruction& model,
                         const colmap::Image& image1,
                         const colmap::Image& image2) {
  const Rigid3d cam2_from_cam1 =
      CamFromWorld(image2) * CamFromWorld(image1).Inverse();
  TwoViewModel two_view;
  two_view.rotation = cam2_from_cam1.rotation.toRotationMatrix();
  two_view.translation = cam2_from_cam1.translation;
  two_view.focal1 = model.Camera(image1.CameraId()).MeanFocalLength();
  two_view.focal2 = model.Camera(image2.CameraId()).MeanFocalLength();
  F_ = two_view.FundamentalMatrix();
  // Images at one centre have no epipolar lines.
  only_turns_ = two_view.translation.isZero(0);
  H_ =
      Eigen::Vector3d(two_view.focal2, two_view.focal2, 1).asDiagonal() *
      two_view.rotation *
      Eigen::Vector3d(1 / two_view.focal1, 1 / two_view.focal1, 1).asDiagonal();
}

double MatchErrors::operator()(const UndistortedKeypoint& keypoint1,
                               const UndistortedKeypoint& keypoint2) const {
  if (!only_turns_) {
    return std::abs(SampsonError(F_,
                                 keypoint1.point,
                                 keypoint2.point,
                                 keypoint1.covariance,
                                 keypoint2.covariance));
  }
  const Eigen::Vector3d turned = H_ * keypoint1.point.homogeneous();
  if (!(turned.z() > 0)) return std::numeric_limits<double>::infinity();
  // Either key point has half of the distance.
  return M_SQRT1_2 * (turned.hnormalized() - keypoint2.point).norm();
}

colmap::FeatureMatches MatchesOfPoses(const MatchErrors& error_px,
                                      const UndistortedKeypoints& keypoints1,
                                      const UndistortedKeypoints& keypoints2,
                                      const colmap::FeatureMatches& matches,
                                      double max_error_px) {
  colmap::FeatureMatches consistent;
  std::vector<bool> is_used1(keypoints1.size(), false);
  std::vector<bool> is_used2(keypoints2.size(), false);
  for (const colmap::FeatureMatch& match : matches) {
    const UndistortedKeypoint& keypoint1 = keypoints1[match.point2D_idx1];
    const UndistortedKeypoint& keypoint2 = keypoints2[match.point2D_idx2];
    if (!is_used1[match.point2D_idx1] && !is_used2[match.point2D_idx2] &&
        error_px(keypoint1, keypoint2) <= max_error_px) {
      is_used1[match.point2D_idx1] = true;
      is_used2[match.point2D_idx2] = true;
      consistent.push_back(match);
    }
  }
  return consistent;
}

}  // namespace dgsfm
