// Positions and gravity of images from all sources, in one frame.

#pragma once

#include "colmap_ext/given_pose.h"
#include "colmap_ext/local_frame.h"
#include "colmap_ext/scene.h"
#include "controllers/commands/command_options.h"

#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

struct PosePriorOptions {
  // Whether positions and gravity are read at all.
  bool use_pose_priors = true;
  // Text file of positions, see ReadPosePriorFile; empty = none.
  std::string path;
  // "wgs84" or "cartesian": what the text file has, and databases that do not
  // say, those of COLMAP 3.8.
  std::string coordinates = "wgs84";
  // Standard deviations of positions without any [m].
  double stddev_horizontal_m = 5;
  double stddev_vertical_m = 10;
  // "latitude,longitude,altitude" [deg, deg, m] of the local frame's origin;
  // empty = the median position.
  std::string origin;

  bool IsValid(std::string* error) const;
};

void BindPosePriors(PosePriorOptions* options, CommandOptions* command_options);

struct LoadedPosePriors {
  PosePriors priors;
  // The frame of the positions, if they are geodetic.
  std::optional<LocalFrame> frame;
  // The same positions with latitude and longitude swapped, if that is
  // possible.
  PosePriors swapped_priors;
  // What is wrong with them, in sentences.
  std::vector<std::string> warnings;
};

// Reads the position of an image from the text file, else from the database,
// else, with image_path, from EXIF, and gravity from the database. Only the
// coordinates of the first source that has any count. Positions with infinite
// covariance, impossible coordinates and such that all images share are left
// out, each with a warning that names the source. Throws std::runtime_error
// naming file and line, or image, on what cannot be read.
LoadedPosePriors LoadPosePriors(const PosePriorOptions& options,
                                const std::string& database_path,
                                const std::string& image_path,
                                const Scene& scene);

}  // namespace dgsfm
