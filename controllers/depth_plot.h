// Depth of a map against depth of triangulated points, as a picture.

#pragma once

#include "estimators/depth_alignment.h"

#include <colmap/util/alignment.h>

#include <colmap/util/bitmap.h>

#include <vector>

namespace dgsfm {

// Both axes are logarithmic and of the same range: depth of the points to the
// right, of the map upwards. Orange with the best scale alone, blue aligned; on
// the diagonal, grey, they are the same.
colmap::Bitmap PlotAlignment(const DepthAlignment& alignment,
                             const std::vector<DepthCorrespondence>& points);

}  // namespace dgsfm
