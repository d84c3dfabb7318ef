#include "controllers/commands/commands.h"
#include "controllers/commands/import_export_options.h"

#include <iostream>

namespace dgsfm {

namespace {

void BindAlignment(DepthAlignmentOptions* options,
                   CommandOptions* command_options) {
  command_options->AddChoice<DepthAlignmentModel>(
      "DepthAlignment.model",
      &options->model,
      {{"scale", DepthAlignmentModel::SCALE},
       {"scale_shift", DepthAlignmentModel::SCALE_SHIFT},
       {"field", DepthAlignmentModel::FIELD}},
      "scale, scale_shift, or field (a smooth field of scales)");
  command_options->Add("DepthAlignment.min_num_points",
                       &options->min_num_points,
                       "Images that see fewer points are left out");
  command_options->Add("DepthAlignment.num_nodes",
                       &options->num_nodes,
                       "Nodes of the field along the longer side");
}

void BindMultiView(MultiViewRefinementOptions* options,
                   CommandOptions* command_options) {
  OptionGroup("MultiViewDepth", command_options)
      .Add("max_num_neighbors",
           &options->neighbors.max_num_neighbors,
           "images that refine the map of an image: those that share most "
           "points")
      .Add("min_angle_deg",
           &options->neighbors.min_angle_deg,
           "... and see them from directions that differ by this [deg]")
      .Add("max_angle_deg",
           &options->neighbors.max_angle_deg,
           "... at most [deg]")
      .Add("max_difference",
           &options->depth.max_difference,
           "largest relative difference of depths that agree")
      .Add("min_confidence",
           &options->depth.min_confidence,
           "pixels of lower confidence, in [0, 1], become unknown; 0.5 is that "
           "of pixels that no other image sees");
}

}  // namespace

void BindOptions(DepthExportOptions* options, CommandOptions* command_options) {
  command_options->AddChoice<DepthExportFormat>(
      "format",
      &options->format,
      {{"npy", DepthExportFormat::NPY},
       {"png", DepthExportFormat::PNG},
       {"exr", DepthExportFormat::EXR},
       {"bin", DepthExportFormat::DENSE_BIN},
       {"3dgs", DepthExportFormat::GAUSSIAN_SPLATTING},
       {"colmap_workspace", DepthExportFormat::COLMAP_WORKSPACE}},
      "npy, png (16 bits), exr, bin (COLMAP's dense maps), 3dgs "
      "(16-bit inverse depth and depth_params.json) or colmap_workspace "
      "(depth and normals for stereo_fusion in a folder that "
      "image_undistorter wrote)");
  command_options->Add(
      "undistorted_path",
      &options->undistorted_path,
      "Model that image_undistorter made of input_path: maps are those "
      "of its images");
  command_options->Add("png_scale",
                       &options->png_scale,
                       "Depth per step of a PNG [unit of depth]");
  BindAlignment(&options->alignment, command_options);
  command_options->Add("multi_view",
                       &options->multi_view,
                       "whether aligned maps are refined by those of "
                       "neighbouring images, and pixels that contradict these "
                       "left out");
  command_options->Add("confidence_path",
                       &options->confidence_path,
                       "(multi_view) folder of confidence maps, PNG of 8 bits: "
                       "0 unknown, 128 seen by no other image, 255 agreed on");
  BindMultiView(&options->refinement, command_options);
  command_options->Add("plot_path",
                       &options->plot_path,
                       "folder of pictures of the alignment: depth of map "
                       "against depth of points, PNG");
  command_options->Add("points_path",
                       &options->points_path,
                       "folder of a copy of the model (of undistorted_path, if "
                       "given) with points of the depth maps, for splatting");
  command_options->Add(
      "num_points", &options->num_points, "(points_path) points at most");
  command_options->Add("image_path",
                       &options->image_path,
                       "(points_path) images of that model, for the colours of "
                       "points");
  command_options->Add("num_threads",
                       &options->num_threads,
                       "Threads that align and write; -1 for one per core");
}

int RunDepthExporter(int argc, char** argv) {
  std::string database_path;
  std::string input_path;
  std::string output_path;
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
  BindOptions(&options, &command);
  if (const auto exit_code = command.Parse(argc, argv)) return *exit_code;
  const std::string needs_model = options.OptionThatNeedsModel();
  if (input_path.empty() && !needs_model.empty()) {
    throw UsageError(needs_model + " needs input_path");
  }
  CheckOptions(options);
  const std::optional<std::string> model_path =
      input_path.empty() ? std::nullopt : std::make_optional(input_path);
  std::cout << ExportDepthMaps(database_path, model_path, output_path, options)
                   .ToText()
            << std::flush;
  return 0;
}

}  // namespace dgsfm
