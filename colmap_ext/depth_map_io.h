// Depth maps from and to files. Reading turns what networks, sensors and
// renderers write into the z-depth of depth_map.h.

#pragma once

#include "colmap_ext/depth_map.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

#include <string>
#include <vector>

namespace dgsfm {

// What a number in a file says about the pixel's ray. Z: third coordinate in
// the camera frame. RANGE: length of the ray. INVERSE: one over the third
// coordinate (disparity).
enum class DepthType { Z, RANGE, INVERSE };

struct DepthReadOptions {
  DepthType type = DepthType::Z;
  // Depth per unit of the file [unit of depth], e.g. 0.001 for millimetres.
  // Depth is scale * number, for INVERSE scale / number. The default takes the
  // numbers of every format, PNG included, as they are.
  double scale = 1;
  DepthUnit unit = DepthUnit::METRIC;

  bool IsValid(std::string* error) const;
};

// File name extensions that ReadDepthMap understands, with the dot.
const std::vector<std::string>& DepthFileExtensions();

// Reads the depth map of an image taken by `camera`; the format follows from
// the extension:
// - .npy: floats of 2, 4 or 8 bytes or integers, any byte order, C or Fortran
//   order, height x width with any further dimensions of size 1;
// - .npz: the array `depth` of such an archive;
// - .pfm: one channel;
// - .png: 16 bits, one channel; 65535 is unknown.
// Everywhere NaN, infinity, zero and negative numbers are unknown.
//
// The map covers the whole image, so its aspect may differ (a network's square
// input, say). A map is refused for its shape only if it is lying while the
// image is standing or the reverse: its transpose has the image's aspect within
// 2 % and it has not, within 2 % and one pixel of rounding per side.
//
// RANGE needs the rays, hence the camera's parameters: depth is as good as the
// focal length there. Pixels without a ray (beyond the reach of the distortion
// model) are unknown.
//
// Throws std::runtime_error naming the file if it cannot be read, is damaged,
// larger than kMaxDepthMapSize, of the wrong shape (then with both sizes), or
// knows the depth of no pixel.
DepthMap ReadDepthMap(const std::string& path,
                      const colmap::Camera& camera,
                      const DepthReadOptions& options);

// Focal length that the depth model saw in the image [px of the image], 0 if
// the file of the depth map says nothing: the mean of fx and fy of the array
// `intrinsics` of a NumPy archive, a camera matrix in units of the map's width
// and height, as MoGe has it, or in pixels of the map; an identity matrix
// counts as none. Throws std::runtime_error naming the file if the array is
// damaged or no camera matrix.
double ReadDepthFocalLength(const std::string& path,
                            const DepthMap& depth_map,
                            const colmap::Camera& camera);

// Write z-depth, unknown as 0. Throw std::runtime_error naming the file.
// Half-precision floats overflow to infinity, that is to unknown, from 65520.
enum class NpyPrecision { HALF, SINGLE };
void WriteDepthNpy(const std::string& path,
                   const DepthMap& depth_map,
                   NpyPrecision precision);
// 16 bits with `scale` [unit of depth] per step. Known depth stays known: it
// saturates at 1 and 65534 steps.
void WriteDepthPng(const std::string& path,
                   const DepthMap& depth_map,
                   double scale);

}  // namespace dgsfm
