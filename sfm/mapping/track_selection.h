// Which tracks are used where memory is bounded.

#pragma once

#include "colmap_ext/scene.h"
#include "sfm/mapping/track_establishment.h"

#include <map>
#include <vector>

namespace dgsfm {

// For each image, whether each of its key points is part of a track; key points
// beyond the last one that is have no value. Empty: no bound, all are used.
using UsedKeypoints = std::map<colmap::image_t, std::vector<bool>>;

// The tracks, in their order, that tell most, at most max_num_tracks of them,
// without what exceeds max_num_observations_per_image. The next track is each
// time one of those that add most: an observation counts 1 / (1 + n), where n
// observations of its image are near it already (in its one of 8 x 8 parts),
// and each pair of images next to each other in the track 8 / (1 + n), where n
// tracks link these already. So long tracks come first, and all parts of images
// and all pairs have some.
std::vector<colmap::Track> SelectTracks(const TrackOptions& options,
                                        const Scene& scene,
                                        std::vector<colmap::Track> tracks);

UsedKeypoints KeypointsOf(const std::vector<colmap::Track>& tracks);

// Whether a key point may get an observation.
bool IsUsed(const UsedKeypoints& used,
            colmap::image_t image_id,
            colmap::point2D_t point2D_idx);

}  // namespace dgsfm
