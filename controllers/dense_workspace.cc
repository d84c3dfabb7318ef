#include "controllers/dense_workspace.h"

#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/depth/normal_map.h"
#include "colmap_ext/output_file.h"
#include "controllers/output_folder.h"

#include <filesystem>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr char kFusionList[] = "stereo/fusion.cfg";
constexpr char kDepthMaps[] = "stereo/depth_maps/";
constexpr char kNormalMaps[] = "stereo/normal_maps/";
constexpr const char* kKinds[] = {".photometric.bin", ".geometric.bin"};

std::string CreatePath(const std::string& workspace_path,
                       const std::string& file) {
  const std::string path = PathInside(workspace_path, file);
  CreateOutputFolder(fs::path(path).parent_path().string());
  return path;
}

// One plane of numbers for each coordinate.
std::string FormatNormals(const DepthMap& depth_map,
                          const std::vector<Eigen::Vector3f>& normals) {
  std::string bytes = std::to_string(depth_map.width) + "&" +
                      std::to_string(depth_map.height) + "&3&";
  for (int i = 0; i < 3; ++i) {
    for (const Eigen::Vector3f& normal : normals) {
      bytes.append(reinterpret_cast<const char*>(&normal[i]), sizeof(float));
    }
  }
  return bytes;
}

}  // namespace

std::string WorkspaceModelPath(const std::string& workspace_path) {
  const fs::path path(workspace_path);
  if (!fs::exists(path / "sparse") || !fs::exists(path / kFusionList)) {
    throw std::runtime_error(
        workspace_path +
        " is no workspace of undistorted images; write it first: colmap "
        "image_undistorter --image_path IMAGES --input_path MODEL "
        "--output_path " +
        workspace_path);
  }
  return (path / "sparse").string();
}

std::string WorkspaceDepthFile(const std::string& image_name) {
  return kDepthMaps + image_name + kKinds[1];
}

std::set<std::string> WorkspaceFiles(const std::string& image_name) {
  std::set<std::string> files;
  for (const char* kind : kKinds) {
    files.insert(kDepthMaps + image_name + kind);
    files.insert(kNormalMaps + image_name + kind);
  }
  return files;
}

void WriteWorkspaceMaps(const std::string& workspace_path,
                        const std::string& image_name,
                        DepthMap depth_map,
                        const colmap::Camera& camera) {
  if (!camera.IsUndistorted()) {
    throw std::runtime_error(workspace_path + ": image " + image_name +
                             " is not undistorted; write the folder by colmap "
                             "image_undistorter");
  }
  const std::vector<Eigen::Vector3f> normals =
      ComputeNormals(depth_map, camera);
  for (size_t i = 0; i < normals.size(); ++i) {
    if (normals[i].isZero()) depth_map.values[i] = 0;
  }
  const std::string normal_bytes = FormatNormals(depth_map, normals);
  for (const char* kind : kKinds) {
    WriteDepthDenseBin(
        CreatePath(workspace_path, kDepthMaps + image_name + kind), depth_map);
    WriteFile(CreatePath(workspace_path, kNormalMaps + image_name + kind),
              normal_bytes);
  }
}

void WriteFusionList(const std::string& workspace_path,
                     const std::vector<std::string>& image_names) {
  std::string text;
  for (const std::string& name : image_names) text += name + "\n";
  WriteFile((fs::path(workspace_path) / kFusionList).string(), text);
}

}  // namespace dgsfm
