// Verification of pairs with more matches than memory has to hold.

#pragma once

#include "controllers/depth_geometric_verifier.h"

#include <cstdint>
#include <map>
#include <vector>

namespace dgsfm {

// As VerifyScenePairs for a scene that keeps some key points of its images
// only: each pair is verified by all its matches, read from the database with
// the key points and depths of its images, and keeps the inliers, and the
// number of matches, of the scene.
PairGeometries VerifyDensePairs(const DepthGeometricVerifierOptions& options,
                                const Scene& scene,
                                std::vector<StageReport>* stages);

// What the stored geometry of each pair of the scene has as its fingerprint if
// it still holds with these options and in this version of the program.
std::map<colmap::image_pair_t, uint64_t> PairFingerprints(
    const DepthGeometricVerifierOptions& options, const Scene& scene);

}  // namespace dgsfm
