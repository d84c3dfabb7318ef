// Positions and gravity of synthetic images with the errors of receivers.

#pragma once

#include "colmap_ext/given_pose.h"
#include "colmap_ext/local_frame.h"
#include "colmap_ext/synthetic/synthetic_scene.h"

#include <string>

namespace dgsfm {

struct PositionNoiseOptions {
  // Whether images have positions.
  bool has_positions = false;
  PositionCoordinates coordinates = PositionCoordinates::WGS84;
  // Standard deviation of each coordinate [m]; also the one that the positions
  // are written with.
  double stddev_m = 2;
  // Share of images, in [0, 1], whose position is off by outlier_m in a random
  // horizontal direction.
  double outlier_ratio = 0;
  double outlier_m = 50;
  // All altitudes are too large by this, as those above another datum [m].
  double altitude_offset_m = 0;
  // Whether images have gravity, and its standard deviation [deg].
  bool has_gravity = false;
  double gravity_stddev_deg = 1;
  // Share of images, in [0, 1], whose gravity has a random direction.
  double gravity_outlier_ratio = 0;

  bool IsValid(std::string* error) const;
};

// Where the origin of the world of synthetic scenes is.
LocalFrame SyntheticFrame();

// Position priors and gravity of all images; none without has_positions and
// has_gravity. Deterministic in the seed of the scene.
GivenPoses SynthesizePosePriors(const PositionNoiseOptions& options,
                                const SyntheticScene& scene);

// Adds the table pose_priors of COLMAP 4.x to a database. Throws
// std::runtime_error if it cannot be written.
void WritePosePriors(const GivenPoses& poses,
                     const SyntheticScene& scene,
                     const std::string& database_path);

}  // namespace dgsfm
