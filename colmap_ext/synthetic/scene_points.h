// Draws the points of a synthetic scene and projects them into its images.

#pragma once

#include "colmap_ext/synthetic/scene_layout.h"
#include "colmap_ext/synthetic/synthetic_scene.h"

#include <colmap/util/types.h>

#include <map>
#include <utility>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Images without common view whose points look alike.
struct FalsePair {
  colmap::image_t a = colmap::kInvalidImageId;
  colmap::image_t b = colmap::kInvalidImageId;
  // The pose that matches of look-alikes suggest.
  Rigid3d b_from_a;
  // Points that look alike: the first may be seen by a, the second by b.
  std::vector<std::pair<int, int>> look_alikes;
};

// Adds points to a scene with cameras and images: their positions, and key
// points to the images that observe them.
class ScenePoints {
 public:
  explicit ScenePoints(SyntheticScene* scene);

  // Draws points of a layout at `origin` until images observe `num_keypoints`
  // on average, as far as they can see any.
  void Draw(const SceneLayout& layout,
            const Eigen::Vector3d& origin,
            size_t num_images,
            int num_keypoints,
            RandomStream* random);

  // Picks images a and b without common view and copies what a and a third
  // image see to where b sees it as the third one does. Throws
  // std::invalid_argument if there are fewer such images.
  std::vector<FalsePair> AddFalsePairs(int num_pairs,
                                       int min_num_matches,
                                       RandomStream* random);

  // Index of the point `step` places further in the row of points that look
  // alike; -1 if there is none.
  int LookAlike(int point_idx, int step) const;
  // Steps from end to end of the longest such row; 0 if all points differ.
  int MaxStep() const { return max_step_; }

 private:
  struct View {
    SyntheticImage* image;
    const colmap::Camera* camera;
    Eigen::Vector3d center;
  };
  // A square of the ground plan.
  using Cell = std::pair<int, int>;

  static Cell CellOf(const Eigen::Vector3d& xyz);
  // `look` is the index of the first point that looks alike.
  void Add(const SurfacePoint& point, int look);
  // Adds key points to all images that see point `point_idx`; their number.
  size_t Observe(const SurfacePoint& point, int point_idx);
  std::vector<FalsePair> SelectFalsePairs(int num_pairs,
                                          int min_num_matches,
                                          RandomStream* random) const;

  SyntheticScene* scene_;
  std::map<Cell, std::vector<View>> views_;  // by the cell of the centre
  std::vector<SurfacePoint> points_;
  // First of the points in a row that look alike, or the point itself.
  std::vector<int> looks_;
  int max_step_ = 0;
};

}  // namespace dgsfm
