// The controller of depth_scene_synthesizer: writes synthetic scenes with exact
// truth, as images with depth maps or as a database of observations.

#pragma once

#include "colmap_ext/synthetic/depth_noise.h"
#include "colmap_ext/synthetic/position_noise.h"
#include "colmap_ext/synthetic/synthetic_camera.h"
#include "colmap_ext/synthetic/synthetic_scene.h"

#include <string>

namespace dgsfm {

struct DepthSceneSynthesizerOptions {
  // New or empty folder; created if missing.
  std::string output_path;
  // Write database.db instead of images and depth maps.
  bool database_only = false;
  // Number of images, family, cameras, depth noise and seed count in both
  // cases, the other fields for databases only.
  SyntheticSceneOptions scene;
  // Positions of the images; databases only.
  PositionNoiseOptions positions;
  // Threads that render; -1 is one per core.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
};

// Writes into the output folder:
// - images/*.jpg and depth/<image name>.npy (z-depth, half floats), or with
//   database_only a COLMAP 3.8 database.db with key points, matches and depth
//   priors;
// - rig_config.json, for a database of a rig, in COLMAP's format;
// - gt/: the true model as text, in metres;
// - gt/depth_scales.txt: a line "image name, true scale" for each image with
//   depth; true depth is the scale times the map, but for the depth errors.
// - gt/origin.txt, with positions of images in the database: latitude,
//   longitude [deg] and altitude [m] of the origin of the true model, whose
//   axes point east, north and up.
// Throws std::runtime_error if the folder is not empty or cannot be written.
void SynthesizeDepthScene(const DepthSceneSynthesizerOptions& options);

}  // namespace dgsfm
