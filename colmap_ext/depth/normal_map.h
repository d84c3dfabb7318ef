// Normals of the surfaces that a depth map shows.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Unit vectors in the camera frame that point to the side of the camera, as
// many as the depth map has pixels, row-major. Zero where depth is unknown, and
// at depth edges, where most pixels around are of other surfaces.
//
// Inverse depth is linear in the pixels of a plane, so that each normal is that
// of the linear function that fits best around the pixel. Noise and the steps
// of stored depth average out over the window.
//
// @param camera  Camera of the image, which the map covers. Throws
//                std::invalid_argument if it has distortion.
std::vector<Eigen::Vector3f> ComputeNormals(const DepthMap& depth_map,
                                            const colmap::Camera& camera);

}  // namespace dgsfm
