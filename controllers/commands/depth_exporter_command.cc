#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"
#include "controllers/depth_exporter.h"

#include <iostream>

namespace dgsfm {
namespace {

void AddOptions(std::string* format,
                std::string* model,
                DepthExportOptions* options,
                CommandOptions* command) {
  command->Add("format",
               format,
               "npy, png (16 bits), exr, bin (COLMAP's dense maps) or 3dgs "
               "(16-bit inverse depth and depth_params.json)");
  command->Add(
      "undistorted_path",
      &options->undistorted_path,
      "Model that image_undistorter made of input_path: maps are those "
      "of its images");
  command->Add("png_scale",
               &options->png_scale,
               "Depth per step of a PNG [unit of depth]");
  command->Add("DepthAlignment.model",
               model,
               "scale, scale_shift, or field (a smooth field of scales)");
  command->Add("DepthAlignment.min_num_points",
               &options->alignment.min_num_points,
               "Images that see fewer points are left out");
  command->Add("DepthAlignment.num_nodes",
               &options->alignment.num_nodes,
               "Nodes of the field along the longer side");
  command->Add("num_threads",
               &options->num_threads,
               "Threads that align and write; -1 for one per core");
}

bool ParseChoices(const std::string& format,
                  const std::string& model,
                  DepthExportOptions* options) {
  return ParseChoice<DepthExportFormat>(
             "format",
             format,
             {{"npy", DepthExportFormat::NPY},
              {"png", DepthExportFormat::PNG},
              {"exr", DepthExportFormat::EXR},
              {"bin", DepthExportFormat::DENSE_BIN},
              {"3dgs", DepthExportFormat::GAUSSIAN_SPLATTING}},
             &options->format) &&
         ParseChoice<DepthAlignmentModel>(
             "DepthAlignment.model",
             model,
             {{"scale", DepthAlignmentModel::SCALE},
              {"scale_shift", DepthAlignmentModel::SCALE_SHIFT},
              {"field", DepthAlignmentModel::FIELD}},
             &options->alignment.model);
}

}  // namespace

int RunDepthExporter(int argc, char** argv) {
  std::string database_path;
  std::string input_path;
  std::string output_path;
  std::string format = "npy";
  std::string model = "field";
  DepthExportOptions options;
  CommandOptions command("depth_exporter",
                         "Writes the depth maps of the database, as they are "
                         "or aligned to a model.");
  command.AddRequired("database_path", &database_path, "COLMAP database");
  command.AddRequired(
      "output_path", &output_path, "Folder of the maps, created if missing");
  command.Add("input_path",
              &input_path,
              "Model to whose points the maps are fitted; without it they are "
              "as they were imported");
  AddOptions(&format, &model, &options, &command);
  if (const auto exit_code = command.Parse(argc, argv)) return *exit_code;
  if (!ParseChoices(format, model, &options)) return 2;
  std::string error;
  if (input_path.empty() && !options.undistorted_path.empty()) {
    std::cerr << "ERROR: undistorted_path needs input_path" << std::endl;
    return 2;
  }
  if (!options.IsValid(&error)) {
    std::cerr << "ERROR: " << error << std::endl;
    return 2;
  }
  const std::optional<std::string> model_path =
      input_path.empty() ? std::nullopt : std::make_optional(input_path);
  std::cout << ExportDepthMaps(database_path, model_path, output_path, options)
                   .ToText()
            << std::flush;
  return 0;
}

}  // namespace dgsfm
