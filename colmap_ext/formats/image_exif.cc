#include "colmap_ext/formats/image_exif.h"

#include "colmap_ext/formats/image_header.h"

#include <cmath>

namespace dgsfm {

namespace {

// Diagonal of a frame of 36 mm x 24 mm.
constexpr double kFilmDiagonalMm = 43.2666;

FITAG* FindTag(const ImageFile& header,
               FREE_IMAGE_MDMODEL model,
               const char* name) {
  FITAG* tag = nullptr;
  FreeImage_GetMetadata(model, header.get(), name, &tag);
  return tag;
}

// As text; empty if there is no such tag.
std::string ReadTag(const ImageFile& header,
                    FREE_IMAGE_MDMODEL model,
                    const char* name) {
  FITAG* tag = FindTag(header, model, name);
  if (tag == nullptr) return "";
  const char* text = FreeImage_TagToString(model, tag, nullptr);
  return text == nullptr ? "" : text;
}

}  // namespace

ImageExif ReadImageExif(const std::string& path) {
  const ImageFile header = ReadImageHeader(path);
  ImageExif exif;
  const std::string make = ReadTag(header, FIMD_EXIF_MAIN, "Make");
  const std::string model = ReadTag(header, FIMD_EXIF_MAIN, "Model");
  if (!make.empty() || !model.empty()) {
    exif.camera = make + "|" + model + "|" +
                  ReadTag(header, FIMD_EXIF_EXIF, "LensModel") + "|" +
                  ReadTag(header, FIMD_EXIF_EXIF, "FocalLength");
  }
  FITAG* tag = FindTag(header, FIMD_EXIF_EXIF, "FocalLengthIn35mmFilm");
  if (tag != nullptr && FreeImage_GetTagType(tag) == FIDT_SHORT &&
      FreeImage_GetTagCount(tag) == 1) {
    exif.focal_length_ratio =
        *static_cast<const uint16_t*>(FreeImage_GetTagValue(tag)) /
        kFilmDiagonalMm;
  }
  return exif;
}

}  // namespace dgsfm
