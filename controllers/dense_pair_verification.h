// Verification of pairs with more matches than memory has to hold.

#pragma once

#include "controllers/depth_geometric_verifier.h"

#include <vector>

namespace dgsfm {

// As VerifyScenePairs for a scene that keeps some key points of its images
// only: each pair is verified by all its matches, read from the database with
// the key points and depths of its images, and keeps the inliers, and the
// number of matches, of the scene.
PairGeometries VerifyDensePairs(const DepthGeometricVerifierOptions& options,
                                const Scene& scene,
                                std::vector<StageReport>* stages);

}  // namespace dgsfm
