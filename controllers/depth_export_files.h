// The files that depth_exporter writes.

#pragma once

#include "controllers/depth_exporter.h"
#include "controllers/splatting_depth.h"

#include <string>
#include <vector>

namespace dgsfm {

// The map of an image, below the folder of the maps.
std::string DepthExportFile(const std::string& image_name,
                            DepthExportFormat format);

// The plot or the confidence map of an image, below the folder of these.
std::string DepthExportPicture(const std::string& image_name);

// Claims (see ClaimFiles) all files of an export: maps of the images, those
// that 3D Gaussian splatting wants of others as well, and what the options
// name. Throws std::runtime_error, before anything is written, if one of them
// is somebody's own.
void ClaimExportFiles(const std::string& output_path,
                      bool has_model,
                      const std::vector<std::string>& images,
                      const SplattingScales& images_for_splatting,
                      const DepthExportOptions& options);

// Writes a file of the options' format, but for COLMAP_WORKSPACE. False if the
// map has depth and the file cannot hold any. Throws std::runtime_error naming
// the file.
bool WriteExportedMap(const std::string& path,
                      const DepthMap& depth_map,
                      const DepthExportOptions& options,
                      double splatting_scale);

// Throws std::runtime_error if points_path is one of the folders.
void CheckPointsPath(const std::string& points_path,
                     const std::vector<std::string>& folders_of_models);

}  // namespace dgsfm
