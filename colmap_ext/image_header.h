// The header of an image file, without its pixels.

#pragma once

#include <memory>
#include <string>

#include <FreeImage.h>

namespace dgsfm {

using ImageHeader = std::unique_ptr<FIBITMAP, decltype(&FreeImage_Unload)>;

// Throws std::runtime_error naming the file if it is no readable image.
ImageHeader ReadImageHeader(const std::string& path);

}  // namespace dgsfm
