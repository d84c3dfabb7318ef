#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <cmath>
#include <string>

namespace dgsfm {

// Images "ring/<i>.jpg" with ids i + 1 on a circle of radius 4 around the
// origin, which they look at from a little above (y points down), and one
// coloured point per image near the origin that this and the next one see.
inline colmap::Reconstruction CreateRingModel(int num_images) {
  colmap::Reconstruction model;
  colmap::Camera camera;
  camera.SetCameraId(1);
  camera.InitializeWithName("SIMPLE_RADIAL", 500, 640, 480);
  model.AddCamera(camera);
  for (int i = 0; i < num_images; ++i) {
    const double angle = 2 * M_PI * i / num_images;
    const Eigen::Vector3d center(4 * std::cos(angle), -1, 4 * std::sin(angle));
    const Eigen::Vector3d forward = -center.normalized();
    const Eigen::Vector3d right =
        Eigen::Vector3d::UnitY().cross(forward).normalized();
    Eigen::Matrix3d cam_from_world_rotation;
    cam_from_world_rotation << right.transpose(),
        forward.cross(right).transpose(), forward.transpose();
    const Eigen::Quaterniond rotation(cam_from_world_rotation);
    colmap::Image image;
    image.SetImageId(i + 1);
    image.SetCameraId(1);
    image.SetName("ring/" + std::to_string(i) + ".jpg");
    image.SetQvec(Eigen::Vector4d(
        rotation.w(), rotation.x(), rotation.y(), rotation.z()));
    image.SetTvec(-(cam_from_world_rotation * center));
    image.SetPoints2D({{320.25, 240.5}, {1. / 3, 2}, {100, 50}});
    model.AddImage(image);
    model.RegisterImage(image.ImageId());
  }
  for (int i = 0; i < num_images; ++i) {
    colmap::Track track;
    track.AddElement(i + 1, 0);
    if (num_images > 1) track.AddElement((i + 1) % num_images + 1, 1);
    const double angle = 2 * M_PI * i / num_images;
    model.AddPoint3D({std::cos(angle), 0.1 * i, std::sin(angle)},
                     track,
                     Eigen::Vector3ub(255, i, 0));
  }
  return model;
}

}  // namespace dgsfm
