// Cameras of synthetic scenes.

#pragma once

#include "colmap_ext/rigid3.h"

#include <colmap/base/camera.h>
#include <colmap/util/types.h>

#include <cstdint>
#include <map>
#include <string>

#include <Eigen/Core>

namespace dgsfm {

// The offsets below are uniform and drawn for each camera; with all of them
// zero the cameras are equal.
struct SyntheticCameraOptions {
  // SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV.
  std::string model_name = "SIMPLE_RADIAL";
  int width_px = 800;
  int height_px = 600;
  double focal_length_px = 700;
  // First radial coefficient [1] of models with distortion.
  double radial_distortion = 0;
  // Images are divided evenly among the cameras in turn; 0 is one per image.
  int num_cameras = 1;
  // Cameras that differ; the others are copies of these in turn, as databases
  // with one camera per image have them. 0 is all.
  int num_distinct_cameras = 0;
  // Each camera's log focal length differs by up to this [1], on top of what
  // its size makes.
  double max_log_focal_offset = 0;
  // Each camera's log width and log height differ by up to this [1]; its focal
  // length keeps the mean field of view.
  double max_log_size_offset = 0;
  // Each camera's radial coefficient differs by up to this [1].
  double max_distortion_offset = 0;
  // Share of cameras, in [0, 1], turned to portrait format.
  double portrait_ratio = 0;
  // Share of cameras, in [0, 1], whose images are crops ...
  double crop_ratio = 0;
  // ... with a principal point off the centre by up to this [width, height].
  double max_crop_offset = 0.2;

  bool IsValid(std::string* error) const;
};

// Cameras with ids from 1 and exact focal length priors. Image i (from 0)
// belongs to camera 1 + i % cameras.size().
std::map<colmap::camera_t, colmap::Camera> SynthesizeCameras(
    const SyntheticCameraOptions& options,
    int num_images,
    uint32_t random_seed);

// Pose of a camera at `center` whose optical axis passes through `target`, its
// x axis horizontal in a world with z up. The axis must not be vertical.
Rigid3d LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target);

Eigen::Vector2d ImageSize(const colmap::Camera& camera);  // [px]

// Image position [px] of a point in the camera frame, if it lies at least
// `min_depth` in front of the camera and falls inside of the image. Directions
// beyond the one at which negative radial distortion folds are not seen.
bool ProjectIntoImage(const colmap::Camera& camera,
                      const Eigen::Vector3d& point_in_cam,
                      double min_depth,
                      Eigen::Vector2d* xy);

}  // namespace dgsfm
