// Rigid transforms in the vocabulary of COLMAP 4.x, which COLMAP 3.8 lacks.

#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

// x_in_b = rotation * x_in_a + translation, named b_from_a: composition reads
// c_from_a = c_from_b * b_from_a. The rotation is a unit quaternion, the
// translation carries the unit of the scene.
struct Rigid3d {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3d() = default;
  Rigid3d(const Eigen::Quaterniond& b_from_a_rotation,
          const Eigen::Vector3d& b_from_a_translation)
      : rotation(b_from_a_rotation), translation(b_from_a_translation) {}

  Rigid3d Inverse() const {
    const Eigen::Quaterniond inverse_rotation = rotation.conjugate();
    return {inverse_rotation, inverse_rotation * -translation};
  }

  // Origin of frame b in frame a: for cam_from_world the projection centre.
  Eigen::Vector3d TargetOriginInSource() const {
    return rotation.conjugate() * -translation;
  }
};

inline Rigid3d operator*(const Rigid3d& c_from_b, const Rigid3d& b_from_a) {
  return {(c_from_b.rotation * b_from_a.rotation).normalized(),
          c_from_b.rotation * b_from_a.translation + c_from_b.translation};
}

inline Eigen::Vector3d operator*(const Rigid3d& b_from_a,
                                 const Eigen::Vector3d& x_in_a) {
  return b_from_a.rotation * x_in_a + b_from_a.translation;
}

// The pose of a pair with scale seen from image 2. The translation changes from
// units of depth map 1 to units of depth map 2: -R^T t / scale_1_from_2.
inline Rigid3d InverseScaledPose(const Rigid3d& cam2_from_cam1,
                                 double scale_1_from_2) {
  Rigid3d cam1_from_cam2 = cam2_from_cam1.Inverse();
  cam1_from_cam2.translation /= scale_1_from_2;
  return cam1_from_cam2;
}

// COLMAP 3.8 and its databases keep rotations as (w, x, y, z).
inline Eigen::Vector4d QvecFromRotation(const Eigen::Quaterniond& rotation) {
  return {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
}

inline Eigen::Quaterniond RotationFromQvec(const Eigen::Vector4d& qvec) {
  return Eigen::Quaterniond(qvec(0), qvec(1), qvec(2), qvec(3)).normalized();
}

}  // namespace dgsfm
