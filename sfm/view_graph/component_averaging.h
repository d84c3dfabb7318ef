// Rotations and depth scales of the images of a connected component from those
// of its pairs, with the filters that take outlying pairs out.

#pragma once

#include "estimators/averaging/gravity_refinement.h"
#include "estimators/averaging/rotation_averaging.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/averaging/translation_averaging.h"
#include "sfm/view_graph/view_graph.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

struct ComponentAveragingOptions {
  GraphAveragingOptions rotation_averaging;
  // Averages rotations this often, taking out pairs that are off by more than
  // max_rotation_error_deg after each [deg].
  int num_rotation_averaging_rounds = 2;
  double max_rotation_error_deg = 10.0;
  // Whether groups of images do not turn, see AverageComponentRotations.
  bool skip_alternatives = false;
  GravityRefinementOptions gravity;
  GraphAveragingOptions scale_averaging;
  // Pairs whose log scale ratio is off by more than this after averaging lose
  // their scale [1].
  double max_log_scale_error = 0.5;
  GraphAveragingOptions translation_averaging;
  // Pairs whose translation is off by more than this after averaging are
  // removed [length of the translation, or the median one if longer] ...
  double max_translation_error_ratio = 0.5;
  // ... if it is also more than this many times the median error of all: with
  // bad depth maps all loops close badly [1].
  double max_translation_error_factor = 6.0;

  bool IsValid(std::string* error) const;
};

struct ComponentRotations {
  // The largest part that the remaining pairs connect, in increasing order,
  // and the rotations of its images; gauge: identity at the smallest id of the
  // component, until that image is cut off.
  std::vector<colmap::image_t> image_ids;
  std::vector<Eigen::Quaterniond> cam_from_world;
  // Parts that lost their connection to it.
  std::vector<std::vector<colmap::image_t>> other_parts;
  size_t num_pairs_filtered = 0;
  // Images whose gravity refined them.
  size_t num_gravities = 0;
};

// Averages the rotations of the valid pairs among the images, which these
// connect, weighted by their evidence. Pairs too far off become
// ROTATION_OUTLIER. If repeated structure contributes more pairs than the true
// path between places, the average rejects the true pairs. Where strong pairs
// are outliers, groups of images turn as a whole as well: these rotations win
// if the cost of matches that pairs miss and of outliers is clearly lower, or
// if that of the outliers alone is lower, too. Images of a frame share its
// rotation, which all their pairs determine. With options.gravity.use_gravity,
// gravity refines the rotations in the end. Nothing if the averaging fails.
std::optional<ComponentRotations> AverageComponentRotations(
    const ComponentAveragingOptions& options,
    const Scene& scene,
    const FrameMembers& frames,
    const std::vector<colmap::image_t>& image_ids,
    int num_threads,
    PairGeometries* pairs);

// Factor of each image's depth map to the common scale.
using ImageScales = std::map<colmap::image_t, double>;

struct ComponentScales {
  // Scales of the images in the largest part that scaled pairs connect; gauge:
  // the median image has scale one.
  ImageScales scales;
  size_t num_pairs = 0;
  // Pairs that lost their scale.
  size_t num_outliers = 0;
};

// Averages the scale ratios of the valid pairs among the images of the index,
// or gives all images the same scale with `skip`.
ComponentScales AverageComponentScales(const ComponentAveragingOptions& options,
                                       bool skip,
                                       const ImageIndex& index,
                                       PairGeometries* pairs);

}  // namespace dgsfm
