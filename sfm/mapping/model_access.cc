#include "sfm/mapping/model_access.h"

#include "colmap_ext/pose_access.h"

#include <algorithm>

namespace dgsfm {

std::vector<colmap::point3D_t> SortedPoints(
    const colmap::Reconstruction& model) {
  std::vector<colmap::point3D_t> point_ids;
  for (const auto& point : model.Points3D()) point_ids.push_back(point.first);
  std::sort(point_ids.begin(), point_ids.end());
  return point_ids;
}

double ReprojectionError(const colmap::Reconstruction& model,
                         const colmap::TrackElement& element,
                         const Eigen::Vector3d& point_in_cam) {
  const colmap::Image& image = model.Image(element.image_id);
  return (model.Camera(image.CameraId())
              .WorldToImage(point_in_cam.hnormalized()) -
          image.Point2D(element.point2D_idx).XY())
      .norm();
}

bool IsAtProjection(const colmap::Reconstruction& model,
                    const colmap::TrackElement& element,
                    const Eigen::Vector3d& xyz,
                    double max_error_px) {
  const Eigen::Vector3d point_in_cam =
      CamFromWorld(model.Image(element.image_id)) * xyz;
  return point_in_cam.z() > 0 &&
         ReprojectionError(model, element, point_in_cam) <= max_error_px;
}

Eigen::Vector3d RayInCam(const colmap::Reconstruction& model,
                         const colmap::TrackElement& element) {
  const colmap::Image& image = model.Image(element.image_id);
  return model.Camera(image.CameraId())
      .ImageToWorld(image.Point2D(element.point2D_idx).XY())
      .homogeneous()
      .normalized();
}

double LargerSide(const colmap::Camera& camera) {
  return double(std::max(camera.Width(), camera.Height()));
}

}  // namespace dgsfm
