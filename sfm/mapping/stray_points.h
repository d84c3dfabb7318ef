// Points of two images at a wrong depth.

#pragma once

#include "sfm/mapping/model_refinement.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <cstddef>

namespace dgsfm {

// Removes points of two images that, in one of the images, are at a distance
// from the camera that no neighbour in the image has
// (max_neighbor_distance_ratio). A wrong match near the epipolar line makes
// such a point, whose reprojection errors are small, and pulls at the poses.
// Points with a small triangulation angle, whose distance is uncertain, stay,
// as do those in images with fewer than min_num_triangulated_per_image other
// points. Returns the number of observations removed; the same for any number
// of threads.
size_t RemoveStrayPoints(const ModelRefinementOptions& options,
                         int num_threads,
                         colmap::Reconstruction* model);

}  // namespace dgsfm
