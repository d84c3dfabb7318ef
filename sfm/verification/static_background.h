// Key points that stay at their place in the images while the scene moves: the
// background of a turntable, a frame, a watermark, dust on the sensor. Where
// they outnumber the others, pairs find the camera at rest (STATIONARY), and
// what moves is lost.

#pragma once

#include "sfm/verification/pair_verification.h"

#include <map>
#include <vector>

namespace dgsfm {

struct StaticKeypoints {
  // Images that stationary pairs connect, in increasing order; at least three.
  std::vector<colmap::image_t> image_ids;
  // Per image and key point, whether most of its matches within the group do
  // not move. At least two matches show that.
  std::map<colmap::image_t, std::vector<char>> is_static;

  bool Contains(colmap::image_t image_id, colmap::point2D_t point2D_idx) const;
};

// Groups by their smallest image. A match does not move if its key points are
// at most `max_motion_px` apart.
std::vector<StaticKeypoints> FindStaticKeypoints(const Scene& scene,
                                                 const PairGeometries& pairs,
                                                 double max_motion_px);

// The matches of the pairs that lose some without the static key points; the
// other pairs of the scene are not in the result.
std::map<colmap::image_pair_t, colmap::FeatureMatches> MatchesThatMove(
    const Scene& scene, const StaticKeypoints& keypoints);

// Number of valid pairs whose translation the matches determine.
size_t CountMovingPairs(const PairGeometries& pairs);

}  // namespace dgsfm
