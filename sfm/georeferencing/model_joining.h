// Models that no match connects, but that are in one frame.

#pragma once

#include "colmap_ext/rig.h"
#include "sfm/georeferencing/model_alignment.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <memory>
#include <vector>

namespace dgsfm {

// Joins the models that are georeferenced into one, the first of them. Cameras
// of a later model that differ from those of the same id in an earlier one get
// ids from `first_new_camera_id` on. So do all cameras of a rig of which one
// differs, or has another pose in it: the frames of that model become those of
// a rig of their own. `rigs` are those of each model. The georeference of the
// joined model counts the images of all and has the sizes of its parts.
void JoinGeoreferencedModels(
    colmap::camera_t first_new_camera_id,
    std::vector<std::unique_ptr<colmap::Reconstruction>>* models,
    std::vector<ModelGeoreference>* georeferences,
    std::vector<RigScene>* rigs);

}  // namespace dgsfm
