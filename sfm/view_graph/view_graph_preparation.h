// The stages before the view graph falls into components: matches and depth
// maps that mislead pairs leave, and focal lengths are averaged.

#pragma once

#include "sfm/mapping_context.h"

#include <map>

namespace dgsfm {

// Key points at rest leave the matches of the scene where more pairs are valid
// without them, see static_background.h.
void DropStaticBackground(const DepthGlobalMapperOptions& options,
                          const PairVerificationOptions& verification,
                          const KeypointDepthMap& depths,
                          Scene* scene,
                          PairGeometries* pairs,
                          MappingLog* log);

// Depth maps that contradict their pairs leave, see depth_reliability.h, and
// these pairs are verified without them. Returns the maps that left.
KeypointDepthMap DropUnreliableDepths(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const Scene& scene,
    KeypointDepthMap* depths,
    PairGeometries* pairs,
    MappingLog* log);

// Filters by what single pairs and their neighbours show, see pair_filters.h.
void FilterPairs(const DepthGlobalMapperOptions& options,
                 const Scene& scene,
                 const PairScores& pair_scores,
                 PairGeometries* pairs,
                 MappingLog* log);

// Sets the focal lengths of the scene's cameras to those averaged over pairs,
// and verifies pairs that lacked them once more, unless that shows the averages
// to be wrong. Returns the averages.
std::map<colmap::camera_t, CameraFocal> AverageFocals(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const KeypointDepthMap& depths,
    Scene* scene,
    PairGeometries* pairs,
    MappingLog* log);

// Warns if nearly all pairs see planes while focal lengths are unknown.
void WarnOfPlanes(const Scene& scene,
                  const PairGeometries& pairs,
                  MappingLog* log);

}  // namespace dgsfm
