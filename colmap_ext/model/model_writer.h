// Writes sparse models, as all versions of COLMAP read them.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <string>

namespace dgsfm {

// Writes cameras.bin, images.bin and points3D.bin with the registered images,
// in the order of the ids, into a folder that exists.
//
// Beside colmap::Reconstruction::Write because that checks no stream: a full
// disk truncates its files without a word. Throws std::runtime_error naming
// the file that cannot be written, or the camera, image or point that has a
// number that is not finite.
void WriteModel(const colmap::Reconstruction& model, const std::string& folder);

}  // namespace dgsfm
