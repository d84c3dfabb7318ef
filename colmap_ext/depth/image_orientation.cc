#include "colmap_ext/depth/image_orientation.h"

#include "colmap_ext/check.h"
#include "colmap_ext/formats/image_header.h"

#include <utility>

namespace dgsfm {

int ReadExifOrientation(const std::string& path) {
  const int orientation =
      ReadExifNumber(ReadImageHeader(path), FIMD_EXIF_MAIN, "Orientation");
  return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

void TurnSize(int orientation, int* width, int* height) {
  if (orientation >= 5) std::swap(*width, *height);
}

std::pair<int, int> DisplayedPixel(
    int orientation, int width, int height, int x, int y) {
  DGSFM_CHECK(orientation >= 1 && orientation <= 8) << orientation;
  // Orientations 1 to 8 in order: four of the same shape, four transposed.
  const int mirrored_x = width - 1 - x;
  const int mirrored_y = height - 1 - y;
  const int xs[] = {x, mirrored_x, mirrored_x, x, y, mirrored_y, mirrored_y, y};
  const int ys[] = {y, y, mirrored_y, mirrored_y, x, x, mirrored_x, mirrored_x};
  return {xs[orientation - 1], ys[orientation - 1]};
}

}  // namespace dgsfm
