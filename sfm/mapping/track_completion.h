// Observations and points that a model gets from tracks of which it has a part.

#pragma once

#include "sfm/mapping/model_refinement.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>
#include <colmap/base/track.h>

#include <vector>

namespace dgsfm {

// Adds the elements of the tracks in registered images whose features have no
// point: to the point of the track, if one of its features has one, or else to
// a new point where their rays meet. Elements stay out that are off the point
// by more than twice max_completion_error_px, and new points whose rays all
// enclose less than min_triangulation_angle_deg. Returns the number of
// observations added; the same for any number of threads.
size_t AddTracks(const std::vector<colmap::Track>& tracks,
                 const ModelRefinementOptions& options,
                 int num_threads,
                 colmap::Reconstruction* model);

}  // namespace dgsfm
