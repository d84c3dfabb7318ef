// The EXIF orientation of a photo, and depth maps of photos that were turned by
// it.

#pragma once

#include <string>
#include <utility>

namespace dgsfm {

// EXIF tag 0x0112, 1 to 8; 1 (as stored) where the file has none. Throws
// std::runtime_error naming the file if it is no readable image.
int ReadExifOrientation(const std::string& path);

// Size of the image as displayed for one of the stored size; the reverse is the
// same function.
void TurnSize(int orientation, int* width, int* height);

// Where the pixel (x, y) of the stored image, width x height, is in the image
// as displayed.
std::pair<int, int> DisplayedPixel(
    int orientation, int width, int height, int x, int y);

}  // namespace dgsfm
