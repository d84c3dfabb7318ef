// Depth maps from and to files. Reading turns what networks, sensors and
// renderers write into the z-depth of depth_map.h.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/formats/depth_file_formats.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

// Meaning of a number in a file. Z: third coordinate in
// the camera frame. RANGE: length of the ray. INVERSE: one over the third
// coordinate (disparity). RELATIVE_DISPARITY and RELATIVE_DEPTH: the same up to
// an unknown scale and shift per image, a / z + b and a z + b.
enum class DepthType { Z, RANGE, INVERSE, RELATIVE_DISPARITY, RELATIVE_DEPTH };
// Whether scale and shift are unknown.
bool IsAffine(DepthType type);

struct DepthReadOptions {
  DepthType type = DepthType::Z;
  // Depth per unit of the file [unit of depth], e.g. 0.001 for millimetres.
  // Depth is scale * number, for INVERSE scale / number. The default takes the
  // numbers of every format, PNG included, as they are.
  double scale = 1;
  // Unit of the depth. Relative disparity and relative depth have none and
  // ignore it.
  DepthUnit unit = DepthUnit::METRIC;
  // Farther is unknown [unit of depth, after scaling]; 0 for no bound.
  double max_depth = 0;
  // Pixels whose confidence is not above 0 and at least this are unknown [unit
  // of the confidence], where the file or a file beside it has a confidence.
  double min_confidence = 0;
  // Pixels are unknown whose confidence is below this share of that of the best
  // pixels of the map, its 95 % quantile; 0 for no bound. Without a confidence
  // it is depth over uncertainty, or one over it for other types than Z and
  // RANGE. Weighted by their confidences such pixels would hardly count.
  double min_relative_confidence = 0.1;
  // Pixels of larger uncertainty are unknown [unit of the uncertainty], where
  // the file has an array of that name; 0 for no bound.
  double max_uncertainty = 0;
  // Largest factor between the width to height ratios of map and image.
  // Networks of square input see a stretched image, so that some difference is
  // meant.
  double max_aspect_factor = 1.5;

  bool IsValid(std::string* error) const;
};

// Arrays in memory: that of a name, if there is one. Called from any thread.
using ArrayReader =
    std::function<std::optional<internal::NumberArray>(const std::string&)>;

// All names of arrays that ReadDepth takes notice of.
inline constexpr const char* kDepthArrayNames[] = {"depth",
                                                   "points",
                                                   "mask",
                                                   "conf",
                                                   "confidence",
                                                   "uncertainty",
                                                   "intrinsics",
                                                   "intrinsic"};

// Where the depth of an image is.
struct DepthFile {
  // With `arrays`, what these are called in messages.
  std::string path;
  // In place of a file, arrays with the names that ReadDepth reads from .npz.
  ArrayReader arrays;
  // Group of the image in an HDF5 file, otherwise empty.
  std::string group;
  // A map of confidence in any format of one array, PNG of 8 bits too; empty
  // for none.
  std::string confidence_path;
  // EXIF orientation of the image where the depth model saw it as displayed; 1
  // for an image as stored.
  int orientation = 1;

  // For messages.
  std::string Description() const;
};

struct ImportedDepth {
  DepthMap depth_map;
  // Share of map pixels with known depth, in (0, 1].
  double coverage = 0;
  // Focal length that the depth model estimated [px of the image]; 0 if the
  // file has none.
  double focal_length_px = 0;
  // Whether the map's aspect is not the image's, within 2 % and one pixel of
  // rounding per side.
  bool is_stretched = false;
};

// File name extensions that ReadDepth understands, with the dot, those of HDF5
// files (many images each) excepted.
const std::vector<std::string>& DepthFileExtensions();

// Reads the depth map of an image taken by `camera`; the format follows from
// the extension:
// - .npy: floats of 2, 4 or 8 bytes or integers, any byte order, C or Fortran
//   order, height x width with any further dimensions of size 1;
// - .npz and a group of .h5 or .hdf5: the array `depth`, without it the last
//   coordinate of `points` (height x width x 3); pixels that the arrays `mask`,
//   `conf` or `confidence`, or `uncertainty` exclude are unknown; the array
//   `intrinsics` or `intrinsic` has the focal length: a camera matrix in units
//   of the map's width and height, as MoGe has it, or in pixels of the map or
//   of the image (its principal point decides), or a vector that
//   begins with the focal length in pixels of the map; an identity matrix
//   counts as none;
// - .exr: see ParseExr; .tif, .tiff: see ReadTiff;
// - .pfm: one channel;
// - .png: 16 bits, one channel; 65535 is unknown;
// - .bin: a map of COLMAP's dense stereo.
// Everywhere NaN, infinity, zero and negative numbers are unknown.
//
// Relative disparity and depth have values of any sign, of which 0 alone is
// unknown; they may be pictures, PNG of 8 or 16 bits, in grey or in three equal
// channels. The largest number of a PNG of relative depth is unknown.
//
// The map covers the whole image, so its aspect may differ (a network's square
// input), up to max_aspect_factor. A map is refused as turned if its
// transpose has the image's aspect within 2 % and it has not, within 2 % and
// one pixel of rounding per side.
//
// RANGE needs the rays, hence the camera's parameters: depth is as good as the
// focal length there. Pixels without a ray (beyond the reach of the distortion
// model) are unknown.
//
// Throws std::runtime_error naming the file if it cannot be read, is damaged,
// larger than kMaxDepthMapSize, of the wrong shape (then with both sizes), or
// has no pixel with known depth.
ImportedDepth ReadDepth(const DepthFile& file,
                        const colmap::Camera& camera,
                        const DepthReadOptions& options);
// Its depth map alone, for an image as stored.
DepthMap ReadDepthMap(const std::string& path,
                      const colmap::Camera& camera,
                      const DepthReadOptions& options);

// Write z-depth, unknown as 0. Throw std::runtime_error naming the file.
// Half-precision floats overflow to infinity, that is to unknown, from 65520.
enum class NpyPrecision { HALF, SINGLE };
void WriteDepthNpy(const std::string& path,
                   const DepthMap& depth_map,
                   NpyPrecision precision);
// 16 bits with `scale` [unit of depth] per step, at least one; beyond 65534
// steps depth becomes unknown. Returns whether any depth is known then.
bool WriteDepthPng(const std::string& path,
                   const DepthMap& depth_map,
                   double scale);
// One channel Z of floats.
void WriteDepthExr(const std::string& path, const DepthMap& depth_map);
// As COLMAP's dense stereo reads it.
void WriteDepthDenseBin(const std::string& path, const DepthMap& depth_map);

}  // namespace dgsfm
