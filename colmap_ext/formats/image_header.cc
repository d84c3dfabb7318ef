#include "colmap_ext/formats/image_header.h"

#include <filesystem>
#include <stdexcept>

namespace dgsfm {

ImageFile ReadImageFile(const std::string& path, int flags) {
  FREE_IMAGE_FORMAT format = FIF_UNKNOWN;
  // FreeImage would wait for the other end of a pipe.
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

int ReadExifNumber(const ImageFile& header,
                   FREE_IMAGE_MDMODEL model,
                   const char* name) {
  FITAG* tag = nullptr;
  FreeImage_GetMetadata(model, header.get(), name, &tag);
  // A tag of another type would be read beyond its end.
  if (tag == nullptr || FreeImage_GetTagType(tag) != FIDT_SHORT ||
      FreeImage_GetTagCount(tag) != 1) {
    return 0;
  }
  return *static_cast<const uint16_t*>(FreeImage_GetTagValue(tag));
}

}  // namespace dgsfm
