// Whether depth maps are what they are said to be, by how their values go
// together with triangulated depth.

#pragma once

#include "sfm/verification/relative_depth.h"

#include <string>
#include <vector>

namespace dgsfm {

// How a map may lie on its image.
enum class MapArrangement {
  AS_GIVEN,
  MIRRORED,     // left and right exchanged
  UPSIDE_DOWN,  // top and bottom exchanged
  HALF_TURN,
  TRANSPOSED,      // rows and columns exchanged
  QUARTER_TURN,    // clockwise
  QUARTER_TURN_3,  // counter-clockwise
  ANTI_TRANSPOSED,
};

// Concordances (see there) of the map of an image with measured depth, for each
// way it may lie and for the kind it is said to be; the opposite kind has the
// negative. `measured` has depths of one unit each, by a model or by pairs. 0
// where too few places of the map are known: between key points, the nearest
// one has the value.
std::vector<double> ConcordancesByArrangement(
    const colmap::Image& image,
    const colmap::Camera& camera,
    const KeypointDepths& depths,
    const std::vector<MeasuredDepths>& measured);

// What is wrong with the maps as a whole, with the remedy; empty if they are
// right. `concordances` has an element per image.
std::string ExplainWrongKind(
    DepthUnit unit, const std::vector<std::vector<double>>& concordances);

// The same by the depths that valid pairs triangulate, of some of the images:
// what is wrong with the maps, affine ones aside.
std::string ExplainWrongKindByPairs(const Scene& scene,
                                    const PairGeometries& pairs,
                                    const KeypointDepthMap& depths);

// Whether all known values of a map are equal: such a map shows no depth.
bool HasOneValue(const KeypointDepths& depths);

}  // namespace dgsfm
