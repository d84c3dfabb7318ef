// Rigs and frames of a model, as COLMAP 4 keeps them beside cameras, images and
// points.

#pragma once

#include "colmap_ext/rig.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <string>

namespace dgsfm {

// Writes rigs.bin and frames.bin of a model. Cameras that are in no rig are one
// by themselves, as are registered images in no frame. Throws
// std::runtime_error naming the file.
void WriteRigs(const RigScene& rigs,
               const colmap::Reconstruction& model,
               const std::string& folder);

}  // namespace dgsfm
