// What the stages share to read a model: its parts in a fixed order, and the
// errors of its features.

#pragma once

#include "colmap_ext/model/registered_images.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <vector>

namespace dgsfm {

// By their ids.
std::vector<colmap::point3D_t> SortedPoints(
    const colmap::Reconstruction& model);

// Distance of a feature from the projection of a point, given in the camera's
// frame with z other than zero [px].
double ReprojectionError(const colmap::Reconstruction& model,
                         const colmap::TrackElement& element,
                         const Eigen::Vector3d& point_in_cam);

// Whether a feature lies within max_error_px of the projection of a point,
// which has to be in front of the camera.
bool IsAtProjection(const colmap::Reconstruction& model,
                    const colmap::TrackElement& element,
                    const Eigen::Vector3d& xyz,
                    double max_error_px);

// Ray of unit length of a feature, in the frame of its camera.
Eigen::Vector3d RayInCam(const colmap::Reconstruction& model,
                         const colmap::TrackElement& element);

// Larger image side [px].
double LargerSide(const colmap::Camera& camera);

}  // namespace dgsfm
