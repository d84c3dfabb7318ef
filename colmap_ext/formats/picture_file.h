// Pictures as files.

#pragma once

#include <colmap/util/bitmap.h>

#include <string>

namespace dgsfm {

// In the format that the extension names, or as PNG. JPEG of superb quality.
// Written by OutputFile; throws std::runtime_error naming the file.
void WritePicture(const std::string& path, const colmap::Bitmap& bitmap);

}  // namespace dgsfm
