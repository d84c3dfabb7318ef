// Which file holds the depth map of which image.

#pragma once

#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/scene.h"

#include <map>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthFileSearch {
  std::map<colmap::image_t, DepthFile> file_of_image;
  // Below the folder, or groups of the HDF5 file; sorted.
  std::vector<std::string> files_without_image;
};

// `depth_path` is a folder or an HDF5 file.
//
// In a folder, the file of an image lies in the same sub-folder as the image
// and is called like it with or without its extension: for image sub/a.jpg
// sub/a.jpg.npy or sub/a.npy, or another of DepthFileExtensions(), in capitals
// too. Of COLMAP's dense maps, a.jpg.geometric.bin goes before
// a.jpg.photometric.bin.
//
// In an HDF5 file, the group of an image is called like it, without its
// extension, or like it without its sub-folders.
//
// Confidence maps, searched for in the same way, need not be complete, but a
// warning counts those that are missing; an empty `confidence_path` means none.
//
// Throws std::runtime_error if the path does not exist, if two files fit one
// image or one file two images, or if no depth map has a confidence map.
DepthFileSearch FindDepthFiles(const Scene& scene,
                               const std::string& depth_path,
                               const std::string& confidence_path);

}  // namespace dgsfm
