// Models of images that turn more than they move, from one centre that all of
// them share at first, and in the end where nothing shows that they moved.

#pragma once

#include "sfm/mapping/model_refinement.h"
#include "sfm/view_graph/component_averaging.h"

#include <colmap/base/reconstruction.h>
#include <colmap/base/track.h>

#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

// Median angle between the outermost viewing rays of tracks, turned by the
// rotations of the model, whose errors are part of it; infinite without tracks.
// Where it is small, centres start better from one place than from pairs, whose
// translations are noise.
double MedianRayAngleDeg(const std::vector<colmap::Track>& tracks,
                         const colmap::Reconstruction& model);

// Registers all images at the origin, and adds a point for each track at unit
// distance in the mean direction of its rays.
void PlaceAtOneCenter(const std::vector<colmap::Track>& tracks,
                      colmap::Reconstruction* model);

// Moves the registered images to the origin, and the points to unit distance
// in the mean direction of their rays.
void MoveToOneCenter(colmap::Reconstruction* model);

// Moves the points of a model with all images at the origin along their rays
// to where scaled depth maps have them: the median of those that see them, and
// points that none sees to the median distance of the others. Returns the
// number of points with depth; without any, points stay.
size_t PlaceAtDepth(const KeypointDepthMap& depths,
                    const ImageScales& scales,
                    colmap::Reconstruction* model);

// Moves points that are much nearer to the images that see them than the median
// point, or much farther away, to its distance along the mean of their rays:
// adjustments leave them where they are, as their projections hardly depend on
// their distance any more. Returns the number of points moved.
size_t MoveStuckPoints(colmap::Reconstruction* model);

// Removes points whose rays enclose less than the error of a key point, so that
// any large distance fits, from a finished model; of a model whose images share
// a centre, points have no other distance. Returns the number of points
// removed.
size_t RemovePointsWithoutDistance(colmap::Reconstruction* model);

// Whether all registered images, at least two, have the same centre, up to
// rounding.
bool IsAtOneCenter(const colmap::Reconstruction& model);

// The cost of the observations of a model, by a loss of errors in px [px^2].
double CostOfObservations(const RobustLoss& loss,
                          const colmap::Reconstruction& model);

// Whether the cost of a model whose images share a centre is as near to that
// of the same observations with free centres as it is expected to be where the
// images do not move.
bool IsExplainedByRotations(double cost_of_one_center,
                            double cost_of_free_centers,
                            const colmap::Reconstruction& model);

// What a user of the model should know of its parallax: that its images share
// a centre, or that most points are seen under smaller angles than this; else
// nothing.
std::optional<std::string> ParallaxAdvice(double min_angle_deg,
                                          const colmap::Reconstruction& model);

}  // namespace dgsfm
