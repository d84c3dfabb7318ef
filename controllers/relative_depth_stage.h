// Maps of unknown scale and shift become depth before pairs are verified.

#pragma once

#include "controllers/depth_geometric_verifier.h"
#include "sfm/verification/relative_depth.h"

#include <vector>

namespace dgsfm {

struct RelativeDepths {
  RelativeDepthFits fits;
  // By what maps became depth.
  AffineDepths conversions;
};

// Turns relative disparity and relative depth among the maps into depth of the
// unit RELATIVE, and takes out those that do not fit what pairs triangulate,
// with a warning each. Nothing happens without such maps.
//
// Pairs with such maps, of each image those with most matches, are verified
// without depth, focal lengths averaged, and the pairs verified once more with
// these; the fit is that of FitRelativeDepths. The result depends on database
// and options alone. Cameras of the scene are as before in the end.
RelativeDepths ConvertRelativeDepths(
    const DepthGeometricVerifierOptions& options,
    Scene* scene,
    KeypointDepthMap* depths,
    std::vector<StageReport>* stages);

}  // namespace dgsfm
