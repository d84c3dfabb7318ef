#pragma once

#include <string>

#include <zip.h>

namespace dgsfm {

// Adds a file, "depth.npy" for the array depth, to a NumPy archive, which is
// created if missing.
void AddToNpz(const std::string& path,
              const std::string& name,
              const std::string& bytes,
              int method = ZIP_CM_DEFLATE);

}  // namespace dgsfm
