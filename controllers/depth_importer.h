// `depth_importer`: depth maps from files into the database, with their values
// at the key points.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/depth/depth_map_io.h"
#include "controllers/depth_kind_warnings.h"

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthImportOptions {
  DepthReadOptions reading;
  DepthSamplingOptions sampling;
  // Folder of confidence maps; empty for none.
  std::string confidence_path;
  // Folder of images whose depth model saw them as displayed, that is turned by
  // their EXIF orientation: maps are turned back. Empty if it saw them as
  // stored, which is how COLMAP sees them.
  std::string displayed_image_path;
  // Stores only the depth at the key points, 4 bytes each.
  bool keypoints_only = false;
  // Imports again what was imported from the same file (by size and time of
  // change) by the same options.
  bool overwrite = false;
  // Threads that read and sample; one per core if not positive.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
};

struct DepthImportSummary {
  struct Image {
    std::string name;
    std::string file;
    int width = 0;  // of the map [px]
    int height = 0;
    double coverage = 0;  // share of map pixels with known depth
    size_t num_keypoints = 0;
    size_t num_keypoints_with_depth = 0;
    // Median depth of these key points [unit of depth]; of relative maps, the
    // median value.
    double median_depth = 0;
    bool is_relative = false;    // relative disparity or relative depth
    double focal_length_px = 0;  // by the depth model, 0 = unknown
    bool is_stretched = false;   // another aspect than the image's
    // What the map looks like, see DepthMapStatistics.
    std::vector<DepthOddity> oddities;
    double lower_to_upper = 1;
  };
  struct Failure {
    std::string name;
    std::string reason;  // names the file
  };

  DepthType type = DepthType::Z;
  // All lists are in the order of image ids, or sorted.
  std::vector<Image> imported;
  // Images whose depth could not be read.
  std::vector<Failure> failed;
  // Images whose depth was there already, from the same file.
  size_t num_unchanged = 0;
  std::vector<std::string> images_without_depth;
  // Number of those with depth from an earlier import.
  size_t num_kept = 0;
  std::vector<std::string> files_without_image;

  // How many images failed and the first reason; for messages.
  std::string FailureText() const;
  // One line per image, failure, file without image and image without depth,
  // one of warning for each way in which maps look like another kind (see
  // DepthKindWarnings); the last line is "imported N
  // of M images, K key points with depth (P %)", where P refers to the key
  // points of the imported images.
  std::string ToText() const;
};

// Stores the depth maps that FindDepthFiles finds and their samples in the
// database. Whether they are the same as those of an earlier import, decides
// which images are read at all: broken off, the import goes on where it
// stopped.
//
// The focal length that comes with a map (see ReadDepth) is stored with it; it
// is a soft prior where the camera has none.
//
// Maps replace those of an earlier import; images without a file keep theirs,
// and so do images whose file cannot be read. Each image is stored as a whole
// or not at all. Where any depth changed pair geometries are deleted, because
// they are relative to the depth maps that they were estimated with.
//
// Throws std::runtime_error naming the file or image if two files fit one image
// or one file two images, or if no file fits any image. The database is then as
// it was.
// The result does not depend on the number of threads. Memory: a few maps per
// thread, whatever the number of images.
DepthImportSummary ImportDepthMaps(const std::string& database_path,
                                   const std::string& depth_path,
                                   const DepthImportOptions& options);
// The same for depth by the names of images, files and arrays in memory, which
// are the same as those of an earlier import if their numbers are.
DepthImportSummary ImportDepthMaps(
    const std::string& database_path,
    const std::map<std::string, DepthFile>& depth_of_image,
    const DepthImportOptions& options);

}  // namespace dgsfm
