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
  // Bounds of the memory that a model takes, 0 = none: tracks, and observations
  // of each image, of which those are used that tell most, see SelectTracks.
  int max_num_tracks = 0;
  int max_num_observations_per_image = 0;

  // Observations of each image up to which models of many images are positioned
  // and adjusted before they are completed, 0 = all. More cost time and move
  // nothing there.
  int max_num_start_observations_per_image = 300;
  // Images from which on a model is one of many images.
  int min_num_images_to_bound_start = 2000;

  bool AreBounded() const {
    return max_num_tracks > 0 || max_num_observations_per_image > 0;
  }
  bool BoundStart(int num_images) const {
    return max_num_start_observations_per_image > 0 &&
           num_images >= min_num_images_to_bound_start;
  }
  // The bounds before a model of many images is completed.
  TrackOptions OfStart() const {
    TrackOptions options = *this;
    options.max_num_tracks = 0;
    options.max_num_observations_per_image =
        max_num_start_observations_per_image;
    return options;
  }

  bool IsValid(std::string* error) const;
};

// Joins the inlier matches of the valid pairs among the images of the index.
// Throws std::runtime_error where these are more features than can be numbered.
// Matches are taken from the strongest pair to the weakest; one that would put
// two features of one image into a track is left out. Tracks have one element
// per image, ordered by image id, and are ordered by their first element.
std::vector<colmap::Track> EstablishTracks(const ImageIndex& index,
                                           const PairGeometries& pairs,
                                           const TrackOptions& options);

}  // namespace dgsfm
