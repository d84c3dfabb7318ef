// What images are called in files of other programs.

#pragma once

#include "colmap_ext/scene.h"

#include <map>
#include <string>

namespace dgsfm {

// Images by their names and by aliases: the name without folders and, if asked
// for, with "-" in place of "/". kInvalidImageId for an alias of several
// images; a full name stands for its image whatever else has it as an alias.
std::map<std::string, colmap::image_t> ImageIdsByName(const Scene& scene,
                                                      bool with_flat_names);

}  // namespace dgsfm
