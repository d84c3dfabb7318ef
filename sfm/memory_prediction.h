// How much memory a mapping needs, before it is done.

#pragma once

#include "sfm/mapping/track_establishment.h"

#include <cstddef>
#include <vector>

namespace dgsfm {

// What the memory depends on.
struct MappingSize {
  size_t num_images = 0;
  // Cameras of these.
  size_t num_cameras = 0;
  // Key points of all images that are used.
  size_t num_keypoints = 0;
  size_t num_pairs = 0;
  // Matches that take part, and how many key points of each image these match.
  size_t num_matches = 0;
  std::vector<size_t> num_matched_keypoints;
  // Pairs of images with an entry in the Cholesky factor of the poses.
  double num_factor_blocks = 0;
};

// Before pairs are verified: all matches may take part. Reads those that the
// scene does not hold.
MappingSize SizeByMatches(const Scene& scene);
// The inliers of the valid pairs take part.
MappingSize SizeByInliers(const Scene& scene, const PairGeometries& pairs);

// Largest resident memory of the process [GB]. Key points that are matched
// count as observations up to the bound of each image; max_num_tracks, whose
// effect depends on the length of the tracks, counts as that many long ones.
double PredictMemoryGb(const TrackOptions& options, const MappingSize& size);

// Throws std::runtime_error naming the option and the value that make the
// mapping fit, if more than limit_gb is needed.
void CheckMemory(double limit_gb,
                 const TrackOptions& options,
                 const MappingSize& size);

}  // namespace dgsfm
