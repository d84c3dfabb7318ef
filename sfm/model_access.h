// What the stages share to go through a model in a fixed order: that of the
// containers of colmap::Reconstruction differs from run to run.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <vector>

namespace dgsfm {

std::vector<colmap::image_t> SortedRegisteredImages(
    const colmap::Reconstruction& model);
std::vector<colmap::point3D_t> SortedPoints(
    const colmap::Reconstruction& model);

}  // namespace dgsfm
