#include "controllers/commands/commands.h"
#include "controllers/commands/import_export_options.h"

#include <iostream>

namespace dgsfm {

void BindOptions(DenseMatchImportOptions* options,
                 CommandOptions* command_options) {
  command_options->Add(
      "merge_radius",
      &options->merge_radius_px,
      "Points of different pairs within this are one key point [px]");
  command_options->Add("min_confidence",
                       &options->min_confidence,
                       "Matches of lower confidence are left out");
  command_options->Add(
      "coordinate_offset",
      &options->coordinate_offset_px,
      "Added to coordinates: 0.5 if the first pixel's centre is (0, 0) "
      "[px]");
  command_options->Add(
      "overwrite",
      &options->overwrite,
      "Whether to replace features and matches of the database");
}

int RunDenseMatchImporter(int argc, char** argv) {
  std::string database_path;
  std::string match_path;
  DenseMatchImportOptions options;
  CommandOptions command("dense_match_importer",
                         "Stores correspondences of dense matchers as key "
                         "points and matches.");
  command.AddRequired("database_path",
                      &database_path,
                      "COLMAP database with images and cameras");
  command.AddRequired("match_path",
                      &match_path,
                      "HDF5 file, .npz archive or folder of .npz archives, a "
                      "group NAME1<>NAME2 per pair with keypoints0, keypoints1 "
                      "(or mkpts0, mkpts1, or matches of 4 columns) and "
                      "confidence");
  BindOptions(&options, &command);
  if (const auto exit_code = command.Parse(argc, argv)) return *exit_code;
  CheckOptions(options);
  std::cout << ImportDenseMatches(
                   database_path, DenseMatchFile(match_path), options)
                   .ToText()
            << std::flush;
  return 0;
}

}  // namespace dgsfm
