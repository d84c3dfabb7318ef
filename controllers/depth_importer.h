// `depth_importer`: depth maps from a folder into the database, with their
// values at the key points.

#pragma once

#include "colmap_ext/depth_map.h"
#include "colmap_ext/depth_map_io.h"

#include <cstddef>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthImportOptions {
  DepthReadOptions reading;
  DepthSamplingOptions sampling;
  // Threads that read and sample; one per core if not positive.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
};

struct DepthImportSummary {
  struct Image {
    std::string name;
    std::string file;  // relative to the depth folder
    int width = 0;     // of the map [px]
    int height = 0;
    double coverage = 0;  // share of map pixels with known depth
    size_t num_keypoints = 0;
    size_t num_keypoints_with_depth = 0;
    double focal_length_px = 0;  // by the depth model, 0 = unknown
  };

  // All lists are in the order of image ids, or sorted.
  std::vector<Image> imported;
  std::vector<std::string> images_without_depth;
  // Of those, how many have a depth map from an earlier import.
  size_t num_kept = 0;
  std::vector<std::string> files_without_image;

  // One line per image, file without image and image without depth; the last
  // line is "imported N of M images, K key points with depth (P %)", where P
  // refers to the key points of the imported images.
  std::string ToText() const;
};

// Stores the depth maps below `depth_path` and their samples in the database.
//
// The map of an image lies in the same sub-folder as the image and is called
// like it with or without its extension: for image sub/a.jpg sub/a.jpg.npy or
// sub/a.npy, or another of DepthFileExtensions().
//
// The focal length that comes with a map (see ReadDepthFocalLength) is stored
// with it; it is a soft prior where the camera has none.
//
// Maps replace those of an earlier import; images without a file keep theirs.
// Pair geometries are deleted, because they are relative to the depth maps
// that they were estimated with.
//
// Throws std::runtime_error naming the file or image if a map cannot be read
// (see ReadDepthMap), if two files fit one image or one file two images, or if
// no file fits any image. The database is then as it was.
// The result does not depend on the number of threads. Memory: a few maps per
// thread.
DepthImportSummary ImportDepthMaps(const std::string& database_path,
                                   const std::string& depth_path,
                                   const DepthImportOptions& options);

}  // namespace dgsfm
