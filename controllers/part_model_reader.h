// Models of parts of a database from their folders.

#pragma once

#include "sfm/mapping/part_model.h"

#include <string>
#include <vector>

namespace dgsfm {

// Reads all models in folders that are separated by commas; none for an empty
// text. Key points of the models are those of the scene at the same place.
// Throws std::runtime_error naming the folder of a model that is damaged, or
// has an image that the scene lacks or whose key points are others.
std::vector<PartModel> ReadPartModels(const std::string& paths,
                                      const Scene& scene);

}  // namespace dgsfm
