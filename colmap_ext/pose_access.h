// The only access to the pose that COLMAP keeps for an image (3.8: quaternion
// and translation in the image; 4.x: a frame).

#pragma once

#include "colmap_ext/rigid3.h"

#include <colmap/util/alignment.h>

#include <colmap/base/image.h>

namespace dgsfm {

inline Rigid3d CamFromWorld(const colmap::Image& image) {
  return {RotationFromQvec(image.Qvec()), image.Tvec()};
}

inline void SetCamFromWorld(const Rigid3d& cam_from_world,
                            colmap::Image* image) {
  image->SetQvec(QvecFromRotation(cam_from_world.rotation));
  image->SetTvec(cam_from_world.translation);
}

// Sets the projection centre and keeps the rotation.
inline void SetCenterInWorld(const Eigen::Vector3d& center,
                             colmap::Image* image) {
  image->SetTvec(RotationFromQvec(image->Qvec()) * -center);
}

}  // namespace dgsfm
