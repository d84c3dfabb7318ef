// The command model_joiner: models of parts of a database become one.

#pragma once

#include "controllers/commands/command_options.h"
#include "controllers/pose_prior_loader.h"
#include "sfm/georeferencing/georeferencing_options.h"
#include "sfm/joining/block_adjustment.h"
#include "sfm/joining/part_joining.h"

#include <string>

namespace dgsfm {

struct PartJoinerOptions {
  std::string database_path;
  // Models of parts of the images: folders, separated by commas.
  std::string input_paths;
  // Folder that receives 0/, 1/, ..., report.json and project.ini; created if
  // missing.
  std::string output_path;
  // Folder of the images, for positions in EXIF data; empty = without.
  std::string image_path;
  // Whether images of rigs of several cameras move each by itself.
  bool ignore_rigs = false;
  // File of COLMAP's rig_configurator, in place of the rigs of the database;
  // empty = none.
  std::string rig_config_path;
  // Whether known poses of cameras in their rigs are those of the parts.
  bool refine_sensor_from_rig = false;
  // Positions of images.
  PosePriorOptions pose_priors;
  GeoreferencingOptions georeferencing;
  PartJoiningOptions joining;
  BlockAdjustmentOptions adjustment;
  // -1 = all processors.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
};

// Binds all options; call before parsing.
void BindOptions(PartJoinerOptions* options, CommandOptions* command_options);

// Joins the models of parts, adjusts what came out of it by blocks of one part
// and writes models, report.json and project.ini. Cameras, images, rigs and
// positions are read from the database, neither key points nor matches. Memory
// grows with the observations of the models. Throws std::invalid_argument on
// options that are not valid, std::runtime_error naming file, image or model.
// Returns what was made, and how good it looks, as text.
std::string JoinParts(const PartJoinerOptions& options);

}  // namespace dgsfm
