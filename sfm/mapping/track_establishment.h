// Tracks: features of several images that show one point of the scene.

#pragma once

#include "sfm/view_graph/view_graph.h"

#include <colmap/base/track.h>

#include <string>
#include <vector>

namespace dgsfm {

struct TrackOptions {
  // Images a track must be seen in (paper: 3 with sparse features, 2 with
  // dense matches).
  int min_num_views_per_track = 3;
  // Images with fewer tracks of that length also use two-view tracks, so that
  // weakly linked images are positioned at all; 0 = never.
  int min_num_tracks_per_view = 50;

  bool IsValid(std::string* error) const;
};

// Joins the inlier matches of the valid pairs among the images of the index.
// Matches are taken from the strongest pair to the weakest; one that would put
// two features of one image into a track is left out. Tracks have one element
// per image, ordered by image id, and are ordered by their first element.
std::vector<colmap::Track> EstablishTracks(const ImageIndex& index,
                                           const PairGeometries& pairs,
                                           const TrackOptions& options);

}  // namespace dgsfm
