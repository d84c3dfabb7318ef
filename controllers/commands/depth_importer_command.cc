#include "controllers/commands/commands.h"
#include "controllers/commands/import_export_options.h"

#include <iostream>

#include <malloc.h>

namespace dgsfm {
namespace {

void AddMeaningOfNumbers(DepthImportOptions* options, CommandOptions* command) {
  command->AddChoice<DepthType>(
      "depth_type",
      &options->reading.type,
      {{"z", DepthType::Z},
       {"range", DepthType::RANGE},
       {"inverse", DepthType::INVERSE},
       {"relative_disparity", DepthType::RELATIVE_DISPARITY},
       {"relative_depth", DepthType::RELATIVE_DEPTH}},
      "What the numbers are: z (third coordinate), range (length of "
      "the ray), inverse (1 / z), or up to an unknown scale and shift "
      "per image relative_disparity (a / z + b: Depth Anything, MiDaS, "
      "DPT) or relative_depth (a z + b: Marigold)");
  command->Add("depth_scale",
               &options->reading.scale,
               "Depth per unit of the files, e.g. 0.001 for millimetres; for "
               "inverse, depth times number");
  command->AddChoice<DepthUnit>(
      "depth_unit",
      &options->reading.unit,
      {{"metric", DepthUnit::METRIC}, {"relative", DepthUnit::RELATIVE}},
      "What depth is measured in after scaling: metric (metres) or "
      "relative (unknown)");
}

void AddExclusions(DepthImportOptions* options, CommandOptions* command) {
  command->Add("max_depth",
               &options->reading.max_depth,
               "Farther is unknown [unit of depth]; 0 for no bound");
  command->Add("confidence_path",
               &options->confidence_path,
               "Folder of confidence maps named as depth maps, PNG of 8 bits "
               "too; .npz and HDF5 have their own");
  command->Add("min_confidence",
               &options->reading.min_confidence,
               "Depth of lower confidence, or of none above 0, is unknown");
  command->Add("min_relative_confidence",
               &options->reading.min_relative_confidence,
               "Depth is unknown whose confidence (or precision, by the "
               "uncertainty) is below this share of that of the best 5 % of "
               "the map; 0 for no bound");
  command->Add("max_uncertainty",
               &options->reading.max_uncertainty,
               "Depth of larger uncertainty (.npz, HDF5) is unknown; 0 for no "
               "bound");
  command->Add("max_aspect_factor",
               &options->reading.max_aspect_factor,
               "Maps whose width to height differs more from the image's are "
               "refused [factor]");
  command->Add("displayed_image_path",
               &options->displayed_image_path,
               "Folder of the images, if the depth model saw them turned by "
               "their EXIF orientation: maps are turned back");
}

void AddStorage(DepthImportOptions* options, CommandOptions* command) {
  command->Add("keypoints_only",
               &options->keypoints_only,
               "Whether to store depth at the key points alone (4 bytes each) "
               "and no maps");
  command->Add("overwrite",
               &options->overwrite,
               "Whether to import again what is there from the same file");
  command->Add("DepthSampling.max_neighbor_ratio",
               &options->sampling.max_neighbor_ratio,
               "Largest ratio of neighbouring depths on one surface [1]");
  command->Add("DepthSampling.keep_edges",
               &options->sampling.keep_edges,
               "Whether key points on depth edges get the nearest depth");
  command->Add("num_threads",
               &options->num_threads,
               "Threads that read and sample; -1 for one per core");
}

}  // namespace

void BindOptions(DepthImportOptions* options, CommandOptions* command_options) {
  AddMeaningOfNumbers(options, command_options);
  AddExclusions(options, command_options);
  AddStorage(options, command_options);
}

int RunDepthImporter(int argc, char** argv) {
  // Keeps the memory of a map for the next one: to return its pages and to
  // fault them in again takes as long as to read the map.
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
  std::string database_path;
  std::string depth_path;
  DepthImportOptions options;
  CommandOptions command("depth_importer",
                         "Stores depth maps and their values at the key points "
                         "in the database.");
  command.AddRequired("database_path", &database_path, "COLMAP database");
  command.AddRequired(
      "depth_path",
      &depth_path,
      "Folder of depth maps named after the images, a.jpg.npy "
      "or a.npy; also .npz, .exr, .tif, .pfm, .png and COLMAP's "
      "dense .bin; or an HDF5 file with a group per image");
  BindOptions(&options, &command);
  if (const auto exit_code = command.Parse(argc, argv)) return *exit_code;
  CheckOptions(options);
  const DepthImportSummary summary =
      ImportDepthMaps(database_path, depth_path, options);
  std::cout << summary.ToText() << std::flush;
  if (summary.failed.empty()) return 0;
  std::cerr << "ERROR: " << summary.FailureText() << std::endl;
  return 1;
}

}  // namespace dgsfm
