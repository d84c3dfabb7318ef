#include "colmap_ext/image_header.h"

#include <filesystem>
#include <stdexcept>

namespace dgsfm {

ImageHeader ReadImageHeader(const std::string& path) {
  FREE_IMAGE_FORMAT format = FIF_UNKNOWN;
  if (std::filesystem::is_regular_file(path)) {
    format = FreeImage_GetFileType(path.c_str(), 0);
  }
  FIBITMAP* bitmap = nullptr;
  if (format != FIF_UNKNOWN) {
    bitmap = FreeImage_Load(format, path.c_str(), FIF_LOAD_NOPIXELS);
  }
  if (bitmap == nullptr) throw std::runtime_error("cannot read image " + path);
  return ImageHeader(bitmap, &FreeImage_Unload);
}

}  // namespace dgsfm
