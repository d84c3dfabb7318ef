// Depth maps of undistorted images.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

namespace dgsfm {

// The map, taken by `camera`, as `undistorted_camera` of the same pose sees it:
// depth z stays, pixels move. As many pixels per pixel of the image; unknown
// where the map does not reach. Depth between pixels as by SampleDepth.
DepthMap UndistortDepth(const DepthMap& depth_map,
                        const colmap::Camera& camera,
                        const colmap::Camera& undistorted_camera);

}  // namespace dgsfm
