#include "controllers/confidence_map.h"

#include "colmap_ext/formats/picture_file.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace dgsfm {

void WriteConfidencePicture(const std::string& path, const DepthMap& values) {
  colmap::Bitmap bitmap;
  if (!bitmap.Allocate(values.width, values.height, /*as_rgb=*/false)) {
    throw std::runtime_error("cannot allocate a picture of this size");
  }
  for (int y = 0; y < values.height; ++y) {
    for (int x = 0; x < values.width; ++x) {
      const float value = values.At(x, y);
      const uint8_t level = static_cast<uint8_t>(
          value > 0 ? std::max(1.0f, std::round(255 * value)) : 0);
      bitmap.SetPixel(x, y, colmap::BitmapColor<uint8_t>(level));
    }
  }
  WritePicture(path, bitmap);
}

}  // namespace dgsfm
