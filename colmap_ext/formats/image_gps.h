// Where a photo was taken, from its EXIF data.

#pragma once

#include <optional>
#include <string>

namespace dgsfm {

struct ImageGps {
  double latitude_deg = 0;
  double longitude_deg = 0;
  // Not finite if the photo has none [m].
  double altitude_m = 0;
  // Horizontal error by the tag GPSHPositioningError; 0 if it has none [m].
  double horizontal_error_m = 0;
};

// Nothing if the photo has no latitude and longitude. Throws std::runtime_error
// naming the file if it cannot be read as an image.
std::optional<ImageGps> ReadImageGps(const std::string& path);

}  // namespace dgsfm
