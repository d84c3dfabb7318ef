// The report as one HTML file without anything outside it: points and cameras
// in 3D, the view graph, missing images, figures of cameras and stages.

#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {

struct ReportPageInput {
  // Shown as heading.
  std::string title;
  // Folders of the models, see FindModels.
  std::vector<std::string> model_folders;
  // report.json and project.ini of depth_global_mapper; empty = none.
  std::string report_path;
  std::string project_path;
  // Folder of the images, for thumbnails; empty = none.
  std::string image_path;
  int num_threads = -1;
};

// What the script of the page gets. Throws std::runtime_error naming the file
// that cannot be read.
nlohmann::ordered_json ReportPageData(const ReportPageInput& input);

// Throws std::runtime_error naming the file that cannot be read or written.
void WriteReportPage(const ReportPageInput& input, const std::string& path);

}  // namespace dgsfm
