#include "colmap_ext/image_orientation.h"

#include "colmap_ext/check.h"

#include <filesystem>
#include <memory>
#include <stdexcept>
#include <utility>

#include <FreeImage.h>

namespace dgsfm {

int ReadExifOrientation(const std::string& path) {
  FREE_IMAGE_FORMAT format = FIF_UNKNOWN;
  if (std::filesystem::is_regular_file(path)) {
    format = FreeImage_GetFileType(path.c_str(), 0);
  }
  FIBITMAP* bitmap = nullptr;
  if (format != FIF_UNKNOWN) {
    bitmap = FreeImage_Load(format, path.c_str(), FIF_LOAD_NOPIXELS);
  }
  if (bitmap == nullptr) throw std::runtime_error("cannot read image " + path);
  const std::unique_ptr<FIBITMAP, decltype(&FreeImage_Unload)> owner(
      bitmap, &FreeImage_Unload);
  FITAG* tag = nullptr;
  FreeImage_GetMetadata(FIMD_EXIF_MAIN, bitmap, "Orientation", &tag);
  if (tag == nullptr || FreeImage_GetTagType(tag) != FIDT_SHORT ||
      FreeImage_GetTagCount(tag) != 1) {
    return 1;
  }
  const int orientation =
      *static_cast<const uint16_t*>(FreeImage_GetTagValue(tag));
  return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

void TurnSize(int orientation, int* width, int* height) {
  if (orientation >= 5) std::swap(*width, *height);
}

std::pair<int, int> DisplayedPixel(
    int orientation, int width, int height, int x, int y) {
  DGSFM_CHECK(orientation >= 1 && orientation <= 8) << orientation;
  const int mirrored_x = width - 1 - x;
  const int mirrored_y = height - 1 - y;
  const int xs[] = {x, mirrored_x, mirrored_x, x, y, mirrored_y, mirrored_y, y};
  const int ys[] = {y, y, mirrored_y, mirrored_y, x, x, mirrored_x, mirrored_x};
  return {xs[orientation - 1], ys[orientation - 1]};
}

}  // namespace dgsfm
