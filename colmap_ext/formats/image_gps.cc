#include "colmap_ext/formats/image_gps.h"

#include "colmap_ext/formats/image_header.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace dgsfm {

namespace {

FITAG* FindTag(const ImageFile& header, const char* name) {
  FITAG* tag = nullptr;
  FreeImage_GetMetadata(FIMD_EXIF_GPS, header.get(), name, &tag);
  return tag;
}

// Rational numbers of a tag; empty without the tag, not finite where the
// denominator is zero.
std::vector<double> ReadRationals(const ImageFile& header, const char* name) {
  std::vector<double> values;
  FITAG* tag = FindTag(header, name);
  if (tag == nullptr || FreeImage_GetTagType(tag) != FIDT_RATIONAL) {
    return values;
  }
  const auto* parts = static_cast<const uint32_t*>(FreeImage_GetTagValue(tag));
  for (uint32_t i = 0; i < FreeImage_GetTagCount(tag); ++i) {
    values.push_back(double(parts[2 * i]) / double(parts[2 * i + 1]));
  }
  return values;
}

// The first character of a text, or byte, of a tag; 0 if there is none.
char ReadLetter(const ImageFile& header, const char* name) {
  FITAG* tag = FindTag(header, name);
  if (tag == nullptr || FreeImage_GetTagLength(tag) == 0) return 0;
  return *static_cast<const char*>(FreeImage_GetTagValue(tag));
}

// Degrees, minutes and seconds, of which the last may be missing.
std::optional<double> ReadAngle(const ImageFile& header,
                                const char* name,
                                const char* reference_name,
                                char negative) {
  const std::vector<double> parts = ReadRationals(header, name);
  if (parts.empty()) return std::nullopt;
  double angle = 0, unit = 1;
  for (const double part : parts) {
    if (std::isfinite(part)) angle += part * unit;
    unit /= 60;
  }
  if (!std::isfinite(parts[0])) return std::nullopt;
  return ReadLetter(header, reference_name) == negative ? -angle : angle;
}

}  // namespace

std::optional<ImageGps> ReadImageGps(const std::string& path) {
  const ImageFile header = ReadImageHeader(path);
  const auto latitude = ReadAngle(header, "GPSLatitude", "GPSLatitudeRef", 'S');
  const auto longitude =
      ReadAngle(header, "GPSLongitude", "GPSLongitudeRef", 'W');
  if (!latitude || !longitude) return std::nullopt;
  ImageGps gps;
  gps.latitude_deg = *latitude;
  gps.longitude_deg = *longitude;
  gps.altitude_m = std::numeric_limits<double>::quiet_NaN();
  const std::vector<double> altitude = ReadRationals(header, "GPSAltitude");
  if (altitude.size() == 1 && std::isfinite(altitude[0])) {
    const bool is_below = ReadLetter(header, "GPSAltitudeRef") == 1;
    gps.altitude_m = is_below ? -altitude[0] : altitude[0];
  }
  // The library has no name for this tag of EXIF 2.31.
  for (const char* name : {"GPSHPositioningError", "Tag 0x001F"}) {
    const std::vector<double> error = ReadRationals(header, name);
    if (error.size() == 1 && std::isfinite(error[0])) {
      gps.horizontal_error_m = error[0];
    }
  }
  return gps;
}

}  // namespace dgsfm
