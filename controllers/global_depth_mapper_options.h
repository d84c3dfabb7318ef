// Options of depth_global_mapper.

#pragma once

#include "controllers/depth_geometric_verifier.h"
#include "controllers/pose_prior_loader.h"
#include "sfm/global_mapping_options.h"

#include <functional>
#include <string>

namespace dgsfm {

struct GlobalDepthMapperOptions {
  // Folder of the images, for the colours of the points and for EXIF; empty =
  // without.
  std::string image_path;
  // Whether the EXIF data of images without a prior focal length count.
  bool use_exif = true;
  // Positions and gravity of images.
  PosePriorOptions pose_priors;
  // Whether images of rigs of several cameras are mapped as if each moved by
  // itself.
  bool ignore_rigs = false;
  // File of COLMAP's rig_configurator, in place of the rigs of the database;
  // empty = none.
  std::string rig_config_path;
  // Existing folder that receives 0/, 1/, ..., report.json, report.html
  // and project.ini.
  std::string output_path;
  // File with the names of the images to map, one a line; empty = all of the
  // database.
  std::string image_list_path;
  // File of pair scores, see ReadPairScores; empty = none.
  std::string pair_scores_path;
  // Images of which more key points are matched use about this many, as dense
  // matchers give each pair its own (see ReadPartOfScene); pairs are
  // verified by all their matches all the same. 0 = all.
  int max_num_keypoints_per_image = 10000;
  // Memory that the run may take, see CheckMemory [GB]; 0 = any.
  double memory_limit_gb = 0;
  // Whether the database gets the geometry of each pair that is verified
  // (dgsfm_pair_geometries), from which a run that was broken off goes on, and
  // in the end the status of each pair (dgsfm_pair_statuses).
  bool write_pair_statuses = true;
  // Whether report.html is written, the report to look at in a browser: 1 yes,
  // 0 no, -1 if there is a folder of images.
  int write_html_report = -1;
  DepthGeometricVerifierOptions verifier;
  DepthGlobalMapperOptions mapper;
  // The method and thresholds of the paper.
  bool paper = false;

  bool WritesHtmlReport() const {
    return write_html_report < 0 ? !image_path.empty() : write_html_report > 0;
  }
};

// Binds all options; call before parsing.
void BindOptions(GlobalDepthMapperOptions* options,
                 CommandOptions* command_options);

// All options but those of threads and places, with their values: what shows
// whether a component that an earlier run mapped still holds.
std::string MappingText(GlobalDepthMapperOptions options);

// Sets the thresholds of the paper's appendix and switches stages off that it
// does not have.
void ApplyPaperPreset(GlobalDepthMapperOptions* options);

// Calls `set`, which sets some of the options, and if these include `paper`,
// once more over the preset, whose values are then the defaults of the others.
void SetOverPreset(const std::function<void()>& set,
                   GlobalDepthMapperOptions* options);

}  // namespace dgsfm
