// Reads a COLMAP database of any version from 3.8 to 4.2 into COLMAP's own
// types. Goes through our own SQLite connection with explicit columns: COLMAP
// 3.8's Database class must never open a foreign database (it overwrites
// user_version before it fails).

#pragma once

#include "colmap_ext/sqlite.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>
#include <colmap/base/image.h>
#include <colmap/feature/types.h>
#include <colmap/util/types.h>

#include <chrono>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// Everything the mapper needs of a COLMAP database, ordered by id.
struct Scene {
  std::map<colmap::camera_t,
           colmap::Camera,
           std::less<colmap::camera_t>,
           Eigen::aligned_allocator<
               std::pair<const colmap::camera_t, colmap::Camera>>>
      cameras;
  // With their key points as Points2D; images without key points have none.
  std::map<
      colmap::image_t,
      colmap::Image,
      std::less<colmap::image_t>,
      Eigen::aligned_allocator<std::pair<const colmap::image_t, colmap::Image>>>
      images;
  // Putative matches of each pair (image_id1 < image_id2 as in the pair id);
  // where a database has only verified matches, those.
  std::map<colmap::image_pair_t, colmap::FeatureMatches> matches;
  // Matches that COLMAP's geometric verification accepted, where it ran.
  std::map<colmap::image_pair_t, colmap::FeatureMatches> verified_matches;
};

// Loads and validates a scene: indices in range, finite key points, known
// cameras and camera models, no duplicate matches (duplicates are removed).
// Throws std::runtime_error naming the file and the image or pair. The
// database is opened read-only and must exist. Multi-camera rigs (COLMAP 3.12
// and later) and camera models that COLMAP 3.8 lacks are refused by name.
Scene ReadScene(const std::string& database_path,
                std::chrono::milliseconds busy_timeout = kDefaultBusyTimeout);
// The same for callers that need only cameras, images and key points.
Scene ReadSceneWithoutMatches(
    const std::string& database_path,
    std::chrono::milliseconds busy_timeout = kDefaultBusyTimeout);

// Image ids of a pair id, the smaller first (COLMAP's pair id formula).
std::pair<colmap::image_t, colmap::image_t> ImageIdsOfPair(
    colmap::image_pair_t pair_id);
colmap::image_pair_t PairIdOfImages(colmap::image_t image_id1,
                                    colmap::image_t image_id2);

}  // namespace dgsfm
