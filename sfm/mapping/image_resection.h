// Images whose matches with the points of a model show another pose than the
// model has for them, or that have none.

#pragma once

#include "sfm/mapping/model_in_progress.h"
#include "sfm/mapping_context.h"

namespace dgsfm {

// Number of images that were placed anew.
struct ResectionSummary {
  size_t num_moved = 0;
  size_t num_registered = 0;
};

// Estimates the pose of each doubtful image from the points of the model that
// other images see at the matches of its key points: of images without a pose,
// and of those where fewer than a third of these points are within
// max_reprojection_error_px. An image takes the pose that COLMAP's LORANSAC
// finds by three points (P3P) if enough points agree with it (min_num_inliers
// and min_inlier_ratio of pairs), and twice as many as before; its observations
// are left out, for tracks to be completed. Images of rigs stay where they are.
ResectionSummary ResectImages(const MappingContext& context,
                              const PairGeometries& pairs,
                              ModelInProgress* progress);

}  // namespace dgsfm
