#include "colmap_ext/formats/image_header.h"

#include <filesystem>
#include <stdexcept>

namespace dgsfm {

ImageFile ReadImageFile(const std::string& path, int flags) {
  FREE_IMAGE_FORMAT format = FIF_UNKNOWN;
  if (std::filesystem::is_regular_file(path)) {
    format = FreeImage_GetFileType(path.c_str(), 0);
  }
  FIBITMAP* bitmap = nullptr;
  if (format != FIF_UNKNOWN) {
    bitmap = FreeImage_Load(format, path.c_str(), flags);
  }
  if (bitmap == nullptr) throw std::runtime_error("cannot read image " + path);
  return ImageFile(bitmap, &FreeImage_Unload);
}

ImageFile ReadImageHeader(const std::string& path) {
  return ReadImageFile(path, FIF_LOAD_NOPIXELS);
}

}  // namespace dgsfm
