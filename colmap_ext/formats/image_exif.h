// Camera, lens and focal length from the EXIF data of a photo.

#pragma once

#include <string>

namespace dgsfm {

struct ImageExif {
  // Make, model, lens and focal length as written; empty if the photo has no
  // make and model.
  std::string camera;
  // Focal length over the diagonal of the image [1], by the tag
  // FocalLengthIn35mmFilm; 0 if it has none.
  double focal_length_ratio = 0;
};

// Throws std::runtime_error naming the file if it is no readable image.
ImageExif ReadImageExif(const std::string& path);

}  // namespace dgsfm
