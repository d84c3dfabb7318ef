// Maps that are depth or disparity up to an unknown scale and shift per image:
// how they are cleaned, sampled, stored and turned into depth.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/types.h>

#include <map>
#include <vector>

namespace dgsfm {

// Whether scale and shift of the values are unknown.
bool IsAffine(DepthUnit unit);

// How depth z follows from the values v of an affine map:
//   AFFINE_DISPARITY: z = scale / (v - shift),
//   AFFINE_DEPTH:     z = (v - shift) / scale.
struct AffineDepth {
  DepthUnit unit = DepthUnit::AFFINE_DISPARITY;
  double scale = 1;  // positive
  double shift = 0;
  // Depth is unknown where v - shift is not above this: its error is as large
  // there.
  double min_difference = 0;
};
using AffineDepths = std::map<colmap::image_t, AffineDepth>;

// Depth for a value of the map, known up to a factor; 0 where it is unknown.
float ConvertAffine(const AffineDepth& affine, float value);

// Turns the values of an affine map into depths of the unit RELATIVE.
void ConvertAffine(const AffineDepth& affine, KeypointDepths* depths);
void ConvertAffine(const AffineDepth& affine, DepthMap* depth_map);

// As SampleDepth(): bilinear in the values, or the nearest where the neighbours
// differ by more than a small part of the range of the map.
std::vector<float> SampleAffine(const DepthMap& depth_map,
                                const std::vector<Eigen::Vector2d>& points,
                                int image_width,
                                int image_height,
                                bool keep_edges);

// An affine map with values that CompressDepth() keeps: as it is if all known
// ones are of its range, otherwise by a linear function of them.
DepthMap StorableAffine(DepthMap depth_map);

}  // namespace dgsfm
