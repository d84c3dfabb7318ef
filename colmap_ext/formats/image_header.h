// Image files as FreeImage reads them: their headers, or all of them.

#pragma once

#include <memory>
#include <string>

#include <FreeImage.h>

namespace dgsfm {

using ImageFile = std::unique_ptr<FIBITMAP, decltype(&FreeImage_Unload)>;

// The flags are those of FreeImage_Load. Throws std::runtime_error naming the
// file if it is no readable image.
ImageFile ReadImageFile(const std::string& path, int flags);

// The same without the pixels.
ImageFile ReadImageHeader(const std::string& path);

// A number of the EXIF data; 0 without it.
int ReadExifNumber(const ImageFile& header,
                   FREE_IMAGE_MDMODEL model,
                   const char* name);

}  // namespace dgsfm
