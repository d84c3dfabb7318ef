// Models of parts of a database from their folders.

#pragma once

#include "sfm/joining/part_model.h"

#include <string>
#include <vector>

namespace dgsfm {

// Reads all models in folders that are separated by commas. The scene needs
// neither key points nor pairs. Throws std::runtime_error naming the folder of
// a model that is damaged, or has an image that the scene lacks, or if there
// are no models.
std::vector<PartModel> ReadPartModels(const std::string& paths,
                                      const Scene& scene);

}  // namespace dgsfm
