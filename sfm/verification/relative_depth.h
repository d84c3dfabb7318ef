// Depth from maps whose scale and shift per image are unknown: relative
// disparity and relative depth.

#pragma once

#include "colmap_ext/depth/affine_depth.h"
#include "estimators/affine_depth_fit.h"
#include "sfm/verification/pair_verification.h"

#include <map>
#include <string>
#include <vector>

namespace dgsfm {

// The depth of a key point by other views [any unit, the same for an image].
struct MeasuredDepth {
  colmap::point2D_t point2D_idx = 0;
  double depth = 0;
};

using MeasuredDepths = std::vector<MeasuredDepth>;
// By each of some pairs of an image, in the unit of the pair.
using DepthsOfPairs = std::map<colmap::image_t, std::vector<MeasuredDepths>>;

// Mean concordance over images beyond which maps are of the kind, and lie on
// their images in the way, that it is measured for: right ones have 0.6 to
// 0.95, other arrangements of the same maps less.
constexpr double kMinMeanConcordance = 0.4;
// With fewer places of an image, or fewer images, it shows nothing.
constexpr size_t kMinNumJudgedPlaces = 30;
constexpr size_t kMinNumJudgedImages = 3;

// Result for an affine map.
struct RelativeDepthFit {
  AffineDepthFit fit;
  // What turns its values into depth, if fit.success: of about 1, or in the
  // unit of a model.
  AffineDepth affine;
};
using RelativeDepthFits = std::map<colmap::image_t, RelativeDepthFit>;

// Whether any of the maps is affine.
bool HasAffineDepths(const KeypointDepthMap& depths);

// Depths of key points of the images that valid pairs triangulate, of at most
// so many pairs of each. All cameras of the scene count as known.
DepthsOfPairs MeasureDepthsByPairs(
    const Scene& scene,
    const PairGeometries& pairs,
    const std::vector<colmap::image_t>& image_ids,
    size_t max_num_pairs);

// Fits the shifts of all affine maps of `depths` to what valid pairs
// triangulate, which were verified without depth. All cameras of the scene
// count as known.
RelativeDepthFits FitRelativeDepths(const Scene& scene,
                                    const PairGeometries& pairs,
                                    const KeypointDepthMap& depths,
                                    const AffineDepthFitOptions& options);

// The fit of an affine map to depths of one unit, in that unit.
RelativeDepthFit FitRelativeDepth(const KeypointDepths& depths,
                                  const MeasuredDepths& measured);

// Turns the affine maps into depth, those without a usable fit leave. Returns
// by what.
AffineDepths ApplyRelativeDepthFits(const RelativeDepthFits& fits,
                                    KeypointDepthMap* depths);

}  // namespace dgsfm
