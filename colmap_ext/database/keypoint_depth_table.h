// Rows of the table of depths at key points, which depth_database.md documents.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/types.h>

#include <cstdint>
#include <string>

namespace dgsfm {

// Throws std::invalid_argument unless the depths are such as can be stored:
// KeypointDepthsOfRow refuses the same.
void CheckKeypointDepths(const KeypointDepths& keypoint_depths);

// Hash of a column with the blob of key points; a NULL is an empty one.
uint64_t KeypointsFingerprint(const SqliteStatement& row, int column);

// What the database has of an image's key points.
struct ImageKeypoints {
  std::string name;  // of the image
  int64_t num_keypoints = 0;
  uint64_t keypoints_fingerprint = 0;
};

// Throws std::runtime_error if there is no such image.
ImageKeypoints ReadImageKeypoints(const SqliteConnection& connection,
                                  colmap::image_t image_id);

// The unit of a row, whose number a damaged file may have changed; throws
// std::runtime_error with the image's name.
DepthUnit CheckedUnit(const SqliteConnection& connection,
                      int64_t unit,
                      const std::string& image_name);

// Selects the rows that KeypointDepthsOfRow reads, with the image's id first.
extern const char kSelectKeypointDepths[];

// Throws std::runtime_error with the image's name if the row is damaged, or
// if the key points are others than at the import.
KeypointDepths KeypointDepthsOfRow(const SqliteConnection& connection,
                                   const SqliteStatement& row);

}  // namespace dgsfm
