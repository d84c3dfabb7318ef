// Lists of images in files, as COLMAP's --image_list_path has them.

#pragma once

#include "colmap_ext/database/scene_database.h"

#include <string>

namespace dgsfm {

// Names, one a line; empty lines do not count. Throws std::runtime_error naming
// the file if it cannot be read or has no name.
ImageNames ReadImageList(const std::string& path);

}  // namespace dgsfm
