// What the finished models show about the depth maps they were given.

#pragma once

#include "sfm/verification/relative_depth.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <memory>
#include <string>
#include <vector>

namespace dgsfm {

using Models = std::vector<std::unique_ptr<colmap::Reconstruction>>;

// Sentences about maps that are of another kind than they are said to be, or
// lie on their images in another way, with the remedy. `depths` are all maps as
// they were imported, those that were not used included.
std::vector<std::string> WarningsOfDepthKinds(const Scene& scene,
                                              const KeypointDepthMap& depths,
                                              const Models& models);

// Scales and shifts of the affine maps of registered images by the points of
// their model, in its unit, with the errors of these fits.
RelativeDepthFits FitRelativeDepthsToModels(const KeypointDepthMap& depths,
                                            const Models& models);

}  // namespace dgsfm
