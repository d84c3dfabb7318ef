// Synthetic scenes as COLMAP's types and files.

#pragma once

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/synthetic/synthetic_scene.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <string>

namespace dgsfm {

// What the mapper sees, as if read from a database, but with key points in
// double precision.
Scene SceneFromSynthetic(const SyntheticScene& synthetic);

// Prior depths of the images that have them.
std::map<colmap::image_t, KeypointDepths> KeypointDepthsFromSynthetic(
    const SyntheticScene& synthetic);

// Low-resolution depth map of an image with depth: prior depth of a key point
// in each cell of `cell_size` pixels, 0 in cells without.
DepthMap DepthMapFromSynthetic(const SyntheticScene& synthetic,
                               colmap::image_t image_id,
                               int cell_size_px);

// Ground truth [m]: true cameras, all images, and the points seen by at least
// two images, with the tracks of their right observations.
colmap::Reconstruction ReconstructionFromSynthetic(
    const SyntheticScene& synthetic);

// Writes a new COLMAP 3.8 database with cameras, images, key points, matches
// and verified pairs, without depth. Throws std::runtime_error if the file
// exists or cannot be created.
void WriteSyntheticDatabase(const SyntheticScene& synthetic,
                            const std::string& path);

}  // namespace dgsfm
