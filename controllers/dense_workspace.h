// The workspace of COLMAP's dense stage: undistorted images that
// image_undistorter wrote, with depth of ours in place of patch_match_stereo's,
// so that stereo_fusion and the meshers go on from there.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

#include <set>
#include <string>
#include <vector>

namespace dgsfm {

// The model of the undistorted images in a workspace. Throws std::runtime_error
// with the remedy if the folder has another content.
std::string WorkspaceModelPath(const std::string& workspace_path);

// File of an image's depth map in the workspace.
std::string WorkspaceDepthFile(const std::string& image_name);

// All files of an image that WriteWorkspaceMaps() writes.
std::set<std::string> WorkspaceFiles(const std::string& image_name);

// Writes depth and normal maps of an image, as both kinds of input that COLMAP
// has ("photometric" and "geometric"). Depth without a normal is unknown in
// them. `camera` is that of the undistorted image, which the map covers. Throws
// std::runtime_error naming the file.
void WriteWorkspaceMaps(const std::string& workspace_path,
                        const std::string& image_name,
                        DepthMap depth_map,
                        const colmap::Camera& camera);

// Has these images fused, and no others: they may have maps of an earlier run.
void WriteFusionList(const std::string& workspace_path,
                     const std::vector<std::string>& image_names);

}  // namespace dgsfm
