#include "colmap_ext/synthetic/synthetic_camera.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/random_stream.h"

#include <colmap/base/camera_models.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

namespace dgsfm {

namespace {

constexpr int kMaxImageSize = 30000;
constexpr double kMaxFocalLength = 1e6;

constexpr uint32_t kFocalPurpose = 200;
constexpr uint32_t kShapePurpose = 201;
constexpr uint32_t kCropPurpose = 202;

colmap::Camera DrawCamera(const SyntheticCameraOptions& options,
                          RandomStream* focal_random,
                          RandomStream* shape_random) {
  const auto draw_factor = [](RandomStream* random, double max_log_offset) {
    return std::exp(max_log_offset * random->Uniform(-1, 1));
  };
  double width =
      std::round(options.width_px *
                 draw_factor(shape_random, options.max_log_size_offset));
  double height =
      std::round(options.height_px *
                 draw_factor(shape_random, options.max_log_size_offset));
  const double size_factor =
      std::sqrt(width * height / options.width_px / options.height_px);
  const double distortion =
      options.radial_distortion +
      options.max_distortion_offset * shape_random->Uniform(-1, 1);
  if (shape_random->Uniform() < options.portrait_ratio) {
    std::swap(width, height);
  }
  colmap::Camera camera;
  camera.InitializeWithName(
      options.model_name,
      options.focal_length_px * size_factor *
          draw_factor(focal_random, options.max_log_focal_offset),
      static_cast<size_t>(width),
      static_cast<size_t>(height));
  camera.SetPriorFocalLength(true);
  if (!camera.ExtraParamsIdxs().empty()) {
    camera.Params(camera.ExtraParamsIdxs()[0]) = distortion;
  }
  return camera;
}

void CropOffCenter(const SyntheticCameraOptions& options,
                   RandomStream* random,
                   colmap::Camera* camera) {
  const bool is_crop = random->Uniform() < options.crop_ratio;
  const double x = options.max_crop_offset * random->Uniform(-1, 1);
  const double y = options.max_crop_offset * random->Uniform(-1, 1);
  if (!is_crop) return;
  camera->SetPrincipalPointX(camera->PrincipalPointX() +
                             x * double(camera->Width()));
  camera->SetPrincipalPointY(camera->PrincipalPointY() +
                             y * double(camera->Height()));
}

}  // namespace

bool SyntheticCameraOptions::IsValid(std::string* error) const {
  const std::set<std::string> models = {
      "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"};
  if (models.count(model_name) == 0) {
    *error =
        "camera model = " + model_name +
        " must be SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV";
  } else if (std::min(width_px, height_px) < 8 ||
             std::max(width_px, height_px) > kMaxImageSize) {
    *error = "image size = " + std::to_string(width_px) + " x " +
             std::to_string(height_px) + " must be from 8 to " +
             std::to_string(kMaxImageSize) + " each way";
  } else if (!(focal_length_px >= 1 && focal_length_px <= kMaxFocalLength)) {
    *error = "focal_length_px = " + std::to_string(focal_length_px) +
             " must be from 1 to " + std::to_string(kMaxFocalLength);
  } else if (!(max_distortion_offset >= 0 &&
               std::abs(radial_distortion) + max_distortion_offset <= 0.2)) {
    // Stronger distortion is not one-to-one in wide images.
    *error =
        "radial_distortion = " + std::to_string(radial_distortion) +
        " +- max_distortion_offset = " + std::to_string(max_distortion_offset) +
        " must be in [-0.2, 0.2]";
  } else if (num_cameras < 0) {
    *error = "num_cameras = " + std::to_string(num_cameras) +
             " must not be negative";
  } else if (num_distinct_cameras < 0) {
    *error = "num_distinct_cameras = " + std::to_string(num_distinct_cameras) +
             " must not be negative";
  } else if (!(max_log_focal_offset >= 0 && max_log_focal_offset <= 1)) {
    *error = "max_log_focal_offset = " + std::to_string(max_log_focal_offset) +
             " must be in [0, 1]";
  } else if (!(max_log_size_offset >= 0 && max_log_size_offset <= 1)) {
    *error = "max_log_size_offset = " + std::to_string(max_log_size_offset) +
             " must be in [0, 1]";
  } else if (!(portrait_ratio >= 0 && portrait_ratio <= 1)) {
    *error = "portrait_ratio = " + std::to_string(portrait_ratio) +
             " must be in [0, 1]";
  } else if (!(crop_ratio >= 0 && crop_ratio <= 1)) {
    *error =
        "crop_ratio = " + std::to_string(crop_ratio) + " must be in [0, 1]";
  } else if (!(max_crop_offset >= 0 && max_crop_offset <= 0.5)) {
    *error = "max_crop_offset = " + std::to_string(max_crop_offset) +
             " must be in [0, 0.5]";
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
  RandomStream focal_random(random_seed, kFocalPurpose);
  RandomStream shape_random(random_seed, kShapePurpose);
  RandomStream crop_random(random_seed, kCropPurpose);
  std::map<colmap::camera_t, colmap::Camera> cameras;
  for (int i = 1; i <= num_cameras; ++i) {
    if (options.num_distinct_cameras > 0 && i > options.num_distinct_cameras) {
      cameras[i] = cameras.at(i - options.num_distinct_cameras);
    } else {
      cameras[i] = DrawCamera(options, &focal_random, &shape_random);
      CropOffCenter(options, &crop_random, &cameras[i]);
    }
    cameras[i].SetCameraId(i);
  }
  return cameras;
}

Eigen::Vector2d ImageSize(const colmap::Camera& camera) {
  return Eigen::Vector2d(camera.Width(), camera.Height());
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
  const Eigen::Vector2d x_norm = point_in_cam.hnormalized();
  const std::vector<size_t>& extra_idxs = camera.ExtraParamsIdxs();
  if (!extra_idxs.empty() &&
      3 * camera.Params(extra_idxs[0]) * x_norm.squaredNorm() <= -1) {
    // The derivative of r * (1 + k * r^2) is not positive.
    return false;
  }
  *xy = camera.WorldToImage(x_norm);
  return xy->x() >= 0 && xy->y() >= 0 && xy->x() < camera.Width() &&
         xy->y() < camera.Height();
}

}  // namespace dgsfm
