// A small town to be rendered: a square with fountain, market stalls and trees
// between coloured houses, a tower behind them and a street leading to it.

#pragma once

#include "colmap_ext/rigid3.h"
#include "colmap_ext/synthetic/ray_caster.h"
#include "colmap_ext/synthetic/scene_layout.h"
#include "colmap_ext/synthetic/synthetic_scene.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <cstdint>
#include <vector>

namespace dgsfm {

// In metres, z up, the fountain at the origin. The houses' facades repeat
// windows and colours; stains and marks follow the seed.
RenderScene CreateTown(uint32_t random_seed);

// Viewpoints for `num_images` images. RING: around the fountain, 12 m from it,
// looking across the square. STREET: 50 m along the street towards the square.
// FACADE: two rows before the houses of the north side. Throws
// std::runtime_error for the other families.
std::vector<Rigid3d> CreateTownViews(SceneFamily family,
                                     int num_images,
                                     uint32_t random_seed);

// The true model of views of the town: cameras and images called
// image0000.jpg, image0001.jpg and so on, no points yet.
colmap::Reconstruction CreateTownModel(const SyntheticSceneOptions& options);

// Adds points of the surfaces to a model with cameras and registered images:
// those that a grid of `num_points_per_image` rays meets and that at least two
// images see, with exact tracks (points of images are appended).
void AddSurfacePoints(const RenderScene& scene,
                      int num_points_per_image,
                      colmap::Reconstruction* model);

}  // namespace dgsfm
