#include "colmap_ext/depth/image_orientation.h"

#include "colmap_ext/check.h"
#include "colmap_ext/formats/image_header.h"

#include <utility>

namespace dgsfm {

int ReadExifOrientation(const std::string& path) {
  const ImageFile header = ReadImageHeader(path);
  FITAG* tag = nullptr;
  FreeImage_GetMetadata(FIMD_EXIF_MAIN, header.get(), "Orientation", &tag);
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
