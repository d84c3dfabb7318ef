#include "controllers/depth_export_files.h"

#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/model/model_writer.h"
#include "controllers/dense_workspace.h"
#include "controllers/depth_export_summary.h"
#include "controllers/output_folder.h"
#include "controllers/splatting_depth.h"

#include <filesystem>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>

namespace dgsfm {

namespace fs = std::filesystem;

std::string DepthExportFile(const std::string& image_name,
                            DepthExportFormat format) {
  static const std::map<DepthExportFormat, std::string> kExtensions = {
      {DepthExportFormat::NPY, ".npy"},
      {DepthExportFormat::PNG, ".png"},
      {DepthExportFormat::EXR, ".exr"},
      {DepthExportFormat::DENSE_BIN, ".geometric.bin"}};
  if (format == DepthExportFormat::COLMAP_WORKSPACE) {
    return WorkspaceDepthFile(image_name);
  }
  const auto extension = kExtensions.find(format);
  return extension == kExtensions.end() ? SplattingFileName(image_name)
                                        : image_name + extension->second;
}

std::string DepthExportPicture(const std::string& image_name) {
  return image_name + ".png";
}

void ClaimExportFiles(const std::string& output_path,
                      bool has_model,
                      const std::vector<std::string>& images,
                      const SplattingScales& images_for_splatting,
                      const DepthExportOptions& options) {
  std::set<std::string> maps;
  std::set<std::string> pictures;
  for (const std::string& name : images) {
    if (options.format == DepthExportFormat::COLMAP_WORKSPACE) {
      maps.merge(WorkspaceFiles(name));
    } else {
      maps.insert(DepthExportFile(name, options.format));
    }
    pictures.insert(DepthExportPicture(name));
  }
  for (const auto& [name, scale] : images_for_splatting) {
    maps.insert(SplattingFileName(name));
  }
  if (options.format == DepthExportFormat::GAUSSIAN_SPLATTING) {
    maps.insert(kSplattingParametersFile);
  }
  if (has_model) maps.insert(kAlignmentsFile);
  std::vector<FilesOfFolder> files = {{output_path, maps}};
  if (!options.plot_path.empty()) {
    files.push_back({options.plot_path, pictures});
  }
  if (!options.confidence_path.empty()) {
    files.push_back({options.confidence_path, pictures});
  }
  if (!options.points_path.empty()) {
    files.push_back({options.points_path,
                     {std::begin(kModelFiles), std::end(kModelFiles)}});
  }
  ClaimFiles(files);
}

bool WriteExportedMap(const std::string& path,
                      const DepthMap& depth_map,
                      const DepthExportOptions& options,
                      double splatting_scale) {
  switch (options.format) {
    case DepthExportFormat::NPY:
      WriteDepthNpy(path, depth_map, NpyPrecision::SINGLE);
      break;
    case DepthExportFormat::PNG:
      return WriteDepthPng(path, depth_map, options.png_scale) ||
             depth_map.Coverage() == 0;
    case DepthExportFormat::EXR:
      WriteDepthExr(path, depth_map);
      break;
    case DepthExportFormat::DENSE_BIN:
      WriteDepthDenseBin(path, depth_map);
      break;
    case DepthExportFormat::GAUSSIAN_SPLATTING:
      WriteSplattingPng(path, depth_map, splatting_scale);
      break;
    case DepthExportFormat::COLMAP_WORKSPACE:
      break;  // No file alone.
  }
  return true;
}

void CheckPointsPath(const std::string& points_path,
                     const std::vector<std::string>& folders_of_models) {
  for (const std::string& folder : folders_of_models) {
    std::error_code is_missing;
    if (!fs::equivalent(points_path, folder, is_missing)) continue;
    throw std::runtime_error("points_path " + points_path +
                             " is the folder of a model that is read: choose "
                             "another folder");
  }
}

}  // namespace dgsfm
