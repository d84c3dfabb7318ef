// Images, cameras and matches in COLMAP's own types, in memory. See
// scene_database.h for where they come from.

#pragma once

#include "colmap_ext/focal_prior.h"
#include "colmap_ext/formats/image_exif.h"
#include "colmap_ext/rig.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>
#include <colmap/base/image.h>
#include <colmap/feature/types.h>
#include <colmap/util/types.h>

#include <map>
#include <utility>
#include <vector>

namespace dgsfm {

using CameraMap =
    std::map<colmap::camera_t,
             colmap::Camera,
             std::less<colmap::camera_t>,
             Eigen::aligned_allocator<
                 std::pair<const colmap::camera_t, colmap::Camera>>>;

// Indices of the key points of an image that are used, in increasing order;
// images that use all of theirs have no entry.
using KeptKeypoints = std::map<colmap::image_t, std::vector<colmap::point2D_t>>;

// Everything the mapper needs of a COLMAP database, ordered by id.
struct Scene {
  CameraMap cameras;
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
  // Where images have more key points than are used, those that Points2D and
  // matches count from.
  KeptKeypoints kept_keypoints;
  // EXIF data of the first image of each camera that is not calibrated, where
  // the image files are at hand.
  std::map<colmap::camera_t, ImageExif> exif;
  // Focal lengths in the database that are EXIF data, see SortPriors.
  std::map<colmap::camera_t, FocalPrior> focal_priors;
  // Images that move together.
  RigScene rigs;
};

// Image ids are smaller, so that a pair id fits into 64 bits.
constexpr colmap::image_pair_t kMaxNumImages = 2147483647;

// Image ids of a pair id, the smaller first (COLMAP's pair id formula).
std::pair<colmap::image_t, colmap::image_t> ImageIdsOfPair(
    colmap::image_pair_t pair_id);
colmap::image_pair_t PairIdOfImages(colmap::image_t image_id1,
                                    colmap::image_t image_id2);

}  // namespace dgsfm
