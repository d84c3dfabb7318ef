#include "colmap_ext/model/model_io.h"
#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"
#include "controllers/mapper_report.h"
#include "controllers/output_folder.h"
#include "controllers/report/report_page.h"

#include <filesystem>
#include <iostream>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

std::string FileIfThere(const fs::path& path) {
  return fs::exists(path) ? path.string() : "";
}

// A run without any model has a report all the same.
std::vector<std::string> ModelsAt(const std::string& path, bool has_report) {
  try {
    return FindModels(path);
  } catch (const std::runtime_error&) {
    if (!has_report) throw;
    return {};
  }
}

}  // namespace

int RunModelReporter(int argc, char** argv) {
  ReportPageInput input;
  std::string input_path, output_path;
  CommandOptions options("model_reporter",
                         "Writes a report page to look at in a browser: points "
                         "and cameras in 3D, pairs, and figures.");
  options.AddRequired("input_path",
                      &input_path,
                      "folder that depth_global_mapper wrote, or any model "
                      "folder");
  options.AddRequired(
      "output_path", &output_path, "page to write, such as report.html");
  options.Add("image_path",
              &input.image_path,
              "folder of the images, for thumbnails; empty = none");
  options.Add("num_threads",
              &input.num_threads,
              "threads that make thumbnails; -1 for one per core");
  if (const auto code = options.Parse(argc, argv)) return *code;

  input.title = FolderName(input_path);
  input.report_path = FileIfThere(fs::path(input_path) / kReportFile);
  input.model_folders = ModelsAt(input_path, !input.report_path.empty());
  input.project_path = FileIfThere(fs::path(input_path) / kProjectFile);
  WriteReportPage(input, output_path);
  AddToRun(output_path);
  std::cout << "Report page: " << output_path << std::endl;
  return 0;
}

}  // namespace dgsfm
