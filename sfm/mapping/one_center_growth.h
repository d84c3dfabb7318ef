// Positions of images that turn more than they move.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <functional>

namespace dgsfm {

// Adjusts poses, points and intrinsics of a model; returns its cost, or a
// negative number if that failed or the model is not worth growing.
using GrowthAdjuster = std::function<double(colmap::Reconstruction*)>;

// Grows a model from one whose images are all at the origin, with turned
// cameras and points at unit distance, of which only the rotations and the
// tracks are used: images that share most points start from one centre, and
// the others follow, each from the centre of its nearest neighbour, once most
// of their points are placed.
//
// With little parallax, points behind and before their mean distance can
// change places if the cameras move the other way: both are tried for the
// first images, and by their points the others cannot differ. All at once
// would be right in one part and reversed in another.
//
// Returns a model with the images that could be placed, at least two, or one
// without points if the first ones could not be or an adjustment failed.
colmap::Reconstruction GrowFromOneCenter(const colmap::Reconstruction& turned,
                                         const GrowthAdjuster& adjust);

}  // namespace dgsfm
