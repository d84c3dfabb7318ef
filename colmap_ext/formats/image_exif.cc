#include "colmap_ext/formats/image_exif.h"

#include "colmap_ext/formats/image_header.h"

namespace dgsfm {

namespace {

// Diagonal of a frame of 36 mm x 24 mm.
constexpr double kFilmDiagonalMm = 43.2666;

// As text; empty if there is no such tag.
std::string ReadTag(const ImageFile& header,
                    FREE_IMAGE_MDMODEL model,
                    const char* name) {
  FITAG* tag = nullptr;
  FreeImage_GetMetadata(model, header.get(), name, &tag);
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
  exif.focal_length_ratio =
      ReadExifNumber(header, FIMD_EXIF_EXIF, "FocalLengthIn35mmFilm") /
      kFilmDiagonalMm;
  return exif;
}

}  // namespace dgsfm
