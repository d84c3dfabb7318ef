// Camera centres chained along pairs whose images have depth scales.

#pragma once

#include "sfm/view_graph/component_averaging.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <optional>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

// Centre of image 2 of a pair, of rotation cam_from_world, given that of image
// 1; the translation is in units of `unit`.
Eigen::Vector3d ChainCenter(const Eigen::Vector3d& center1,
                            const Eigen::Quaterniond& rotation2,
                            const Rigid3d& cam2_from_cam1,
                            double unit);

// Centres by position in the index: c_j = c_i - R_j^T s_i t_ij along the
// maximum spanning tree of the scaled pairs by number of inliers (DGSfM Eq. 12,
// 13), from the best connected image. Rotations are those of the model. Images
// that the tree does not reach have none.
std::vector<std::optional<Eigen::Vector3d>> ChainScaledCenters(
    const ImageIndex& index,
    const PairGeometries& pairs,
    const ImageScales& scales,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
