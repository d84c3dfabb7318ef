// What the prior focal lengths in a database are: calibrations or EXIF data.

#pragma once

#include "colmap_ext/scene.h"

#include <map>
#include <optional>
#include <string>

namespace dgsfm {

// How prior focal lengths are read.
enum class PriorTrust {
  AUTO,        // as EXIF data where they look like them, else as calibrations
  EXIF,        // all as EXIF data
  CALIBRATED,  // all as calibrations
};

// By the names "auto", "exif" and "calibrated"; nothing for other names.
std::optional<PriorTrust> PriorTrustFromName(const std::string& name);

// Whether a camera looks as COLMAP's feature_extractor writes it for a photo
// with a focal length in its EXIF data: prior flag set, one focal length,
// principal point exactly at the centre of the image, distortion exactly zero.
// Not cameras of fisheye models, without whose focal length pairs have no
// geometry at all.
bool LooksLikeExif(const colmap::Camera& camera);

// Separates calibrated cameras, which keep their prior flag, from those whose
// focal length is EXIF data: these lose the flag and get a soft prior in
// scene->focal_priors instead, of standard deviation 5 % (whole millimetres,
// 35 mm equivalents by the diagonal or the width, lenses that breathe).
void SortPriors(PriorTrust trust, Scene* scene);

// The soft prior of a camera that is not calibrated: that of the database, else
// that of the EXIF data of its first image; one that does not exist if there
// are neither.
FocalPrior FocalPriorOf(const Scene& scene, colmap::camera_t camera_id);

}  // namespace dgsfm
