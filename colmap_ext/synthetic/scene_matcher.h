// Matches the images of a synthetic scene.

#pragma once

#include "colmap_ext/synthetic/covisibility.h"
#include "colmap_ext/synthetic/scene_points.h"
#include "colmap_ext/synthetic/synthetic_scene.h"

#include <colmap/feature/types.h>
#include <colmap/util/types.h>

#include <map>
#include <set>
#include <utility>
#include <vector>

namespace dgsfm {

// Adds the pairs to a scene with final key points: those with common points,
// those with points that look alike, and the wrong matches of both.
class SceneMatcher {
 public:
  SceneMatcher(const ScenePoints& points, SyntheticScene* scene);

  // `false_pairs` must have no common points.
  void Match(const std::vector<FalsePair>& false_pairs);

 private:
  using ImagePairs = std::set<std::pair<colmap::image_t, colmap::image_t>>;

  ImagePairs SelectPairs() const;
  // The rigid motion from the first points to the second ones.
  Rigid3d MotionOf(const std::vector<std::pair<int, int>>& point_idxs) const;
  // The image of another place that shows most points that look like those of
  // `image`, `step` places further; pair.b is invalid if there is none.
  FalsePair FindLookAlike(const SyntheticImage& image, int step) const;
  void MatchRepeats();
  void MatchCommonPoints(const ImagePairs& image_pairs);
  void MatchLookAlikes(const FalsePair& false_pair);
  void AddOutliers(colmap::image_t image_id1,
                   colmap::image_t image_id2,
                   SyntheticPair* pair) const;
  void Add(colmap::image_t image_id1,
           colmap::image_t image_id2,
           SyntheticPair pair);

  const ScenePoints& points_;
  SyntheticScene* scene_;
  Covisibility covisibility_;
};

}  // namespace dgsfm
