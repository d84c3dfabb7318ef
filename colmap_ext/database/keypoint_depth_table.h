// Rows of the table of depths at key points, which depth_database.md documents.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/types.h>

#include <cstdint>
#include <string>

namespace dgsfm {

// Depths that KeypointDepthsOfRow would refuse throw std::invalid_argument.
void CheckKeypointDepths(const KeypointDepths& keypoint_depths);

// Hash of a column with the blob of key points; a NULL is an empty one.
uint64_t KeypointsFingerprint(const SqliteStatement& row, int column);

// What the database has of an image's key points.
struct ImageKeypoints {
  std::string name;  // of the image
  int64_t num_keypoints = 0;
  uint64_t keypoints_fingerprint = 0;
};

// An id that no image has throws std::runtime_error.
ImageKeypoints ReadImageKeypoints(const SqliteConnection& connection,
                                  colmap::image_t image_id);

// The unit of a row, whose number a damaged file may have changed; throws
// std::runtime_error with the image's name.
DepthUnit CheckedUnit(const SqliteConnection& connection,
                      int64_t unit,
                      const std::string& image_name);

// Selects the rows that KeypointDepthsOfRow reads, with the image's id first.
extern const char kSelectKeypointDepths[];

// A damaged row, and key points other than at the import, throw
// std::runtime_error with the image's name.
KeypointDepths KeypointDepthsOfRow(const SqliteConnection& connection,
                                   const SqliteStatement& row);

}  // namespace dgsfm
