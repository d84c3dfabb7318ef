// What images are called in files of other programs.

#pragma once

#include "colmap_ext/scene.h"

#include <map>
#include <string>

namespace dgsfm {

// Images by their names, and by those without folders and with "-" in place of
// "/" that no other image has; kInvalidImageId for what several are called. A
// full name stands for its image whatever else has it as such an alias.
std::map<std::string, colmap::image_t> ImageIdsByName(const Scene& scene);

}  // namespace dgsfm
