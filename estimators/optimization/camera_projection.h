// Projections of COLMAP's camera models with derivatives.

#pragma once

#include <Eigen/Core>

namespace dgsfm {

// Largest number of parameters of the camera models of COLMAP 3.8.
constexpr int kMaxNumCameraParams = 12;

// Derivatives of a projection [px] by the point in the camera frame and by the
// camera's parameters in COLMAP's order; columns beyond these are undefined.
struct ProjectionJacobian {
  Eigen::Matrix<double, 2, 3> point;
  Eigen::Matrix<double, 2, kMaxNumCameraParams> params;
};

// Projects a point of the camera frame to the image [px], behind the camera
// too, as COLMAP's bundle adjustment does. `jacobian` may be null. False in the
// plane of the projection centre.
using ProjectionFunction = bool (*)(const double* params,
                                    const Eigen::Vector3d& point_in_cam,
                                    Eigen::Vector2d* xy_px,
                                    ProjectionJacobian* jacobian);

// Derivatives are analytic for SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL
// and OPENCV, automatic for the rest. Throws on unknown models.
ProjectionFunction ProjectionOfModel(int camera_model_id);

// All models by automatic differentiation.
ProjectionFunction AutoDiffProjectionOfModel(int camera_model_id);

}  // namespace dgsfm
