#include "colmap_ext/synthetic/synthetic_camera.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/random_stream.h"

#include <colmap/base/camera_models.h>

#include <cmath>
#include <set>

namespace dgsfm {

namespace {

constexpr uint32_t kCameraPurpose = 200;

}  // namespace

bool SyntheticCameraOptions::IsValid(std::string* error) const {
  const std::set<std::string> models = {
      "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"};
  if (models.count(model_name) == 0) {
    *error =
        "camera model = " + model_name +
        " must be SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV";
  } else if (width_px < 8 || height_px < 8) {
    *error = "image size = " + std::to_string(width_px) + " x " +
             std::to_string(height_px) + " must be at least 8 x 8";
  } else if (!(focal_length_px > 0)) {
    *error = "focal_length_px = " + std::to_string(focal_length_px) +
             " must be positive";
  } else if (!(std::abs(radial_distortion) <= 0.2)) {
    // Stronger distortion is not one-to-one in wide images.
    *error = "radial_distortion = " + std::to_string(radial_distortion) +
             " must be in [-0.2, 0.2]";
  } else if (num_cameras < 0) {
    *error = "num_cameras = " + std::to_string(num_cameras) +
             " must not be negative";
  } else if (!(max_log_focal_offset >= 0 && max_log_focal_offset <= 1)) {
    *error = "max_log_focal_offset = " + std::to_string(max_log_focal_offset) +
             " must be in [0, 1]";
  } else {
    return true;
  }
  return false;
}

std::map<colmap::camera_t, colmap::Camera> SynthesizeCameras(
    const SyntheticCameraOptions& options,
    int num_images,
    uint32_t random_seed) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const int num_cameras =
      options.num_cameras > 0 ? options.num_cameras : num_images;
  RandomStream random(random_seed, kCameraPurpose);
  std::map<colmap::camera_t, colmap::Camera> cameras;
  for (int i = 1; i <= num_cameras; ++i) {
    const double offset = options.max_log_focal_offset * random.Uniform(-1, 1);
    colmap::Camera camera;
    camera.InitializeWithName(options.model_name,
                              options.focal_length_px * std::exp(offset),
                              options.width_px,
                              options.height_px);
    camera.SetCameraId(i);
    camera.SetPriorFocalLength(true);
    if (!camera.ExtraParamsIdxs().empty()) {
      camera.Params(camera.ExtraParamsIdxs()[0]) = options.radial_distortion;
    }
    cameras.emplace(i, camera);
  }
  return cameras;
}

Rigid3d LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target) {
  const Eigen::Vector3d z_axis = (target - center).normalized();
  const Eigen::Vector3d x_axis =
      z_axis.cross(Eigen::Vector3d::UnitZ()).normalized();
  DGSFM_CHECK(x_axis.allFinite() && x_axis.norm() > 0.5)
      << "the viewing direction is vertical or empty";
  Eigen::Matrix3d cam_from_world;
  cam_from_world << x_axis.transpose(), z_axis.cross(x_axis).transpose(),
      z_axis.transpose();
  const Eigen::Quaterniond rotation(cam_from_world);
  return {rotation, rotation * -center};
}

bool ProjectIntoImage(const colmap::Camera& camera,
                      const Eigen::Vector3d& point_in_cam,
                      double min_depth,
                      Eigen::Vector2d* xy) {
  if (point_in_cam.z() < min_depth) return false;
  *xy = camera.WorldToImage(point_in_cam.hnormalized());
  return xy->x() >= 0 && xy->y() >= 0 && xy->x() < camera.Width() &&
         xy->y() < camera.Height();
}

}  // namespace dgsfm
