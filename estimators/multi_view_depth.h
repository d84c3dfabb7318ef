// Refines an aligned depth map by those of images that see the same surfaces.
//
// Each pixel of known depth is a point, which is looked for in the maps of the
// neighbours. A neighbour
//   agrees       if its depth there is the point's within the errors of both;
//   contradicts  if it sees through the point, to a farther surface, or shows a
//                surface that the pixel sees through;
//   is silent    if a nearer surface hides the point from it, and where its
//                depth is unknown, an edge, or out of the image.
// The refined depth is where the ray of the pixel meets the surfaces of the
// neighbours that agree: the mean of the logarithms, its own depth included,
// weighted by the errors of the maps and robust.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "estimators/depth_alignment.h"
#include "estimators/view_comparison.h"

#include <string>
#include <vector>

namespace dgsfm {

struct MultiViewDepthOptions {
  // Depths agree within this relative difference, or less if the errors of the
  // maps are small.
  double max_difference = 0.05;
  // Pixels of lower confidence become unknown: with 0.5, those that more
  // neighbours contradict than agree with; with 0, none.
  double min_confidence = 0.5;

  bool IsValid(std::string* error) const;
};

struct RefinedDepth {
  DepthMap depth_map;
  // (agreeing + 1/2) / (agreeing + contradicting + 1) neighbours, in (0, 1),
  // before pixels are dropped: 0.5 where no other view sees the point. 0 where
  // the depth was unknown.
  std::vector<float> confidence;
  // Shares of the known pixels [0 to 1].
  double agreeing_ratio = 0;  // with a neighbour
  double dropped_ratio = 0;
};

// The depths of the map, at a grid of its pixels, and those that it has
// together with neighbours that agree: correspondences of AlignDepth, by which
// a field of the map is corrected.
std::vector<DepthCorrespondence> FindAgreements(
    const DepthView& view,
    const std::vector<const DepthView*>& neighbors,
    const MultiViewDepthOptions& options);

// The same for any number of threads.
RefinedDepth RefineDepth(const DepthView& view,
                         const std::vector<const DepthView*>& neighbors,
                         const MultiViewDepthOptions& options,
                         int num_threads);

}  // namespace dgsfm
