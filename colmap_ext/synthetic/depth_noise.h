// Errors of depth priors as those of monocular networks: a wrong scale per
// image, an error that varies smoothly over the image, noise with light or
// heavy tails, gross errors, blurred edges, and maps that show something else.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>
#include <colmap/util/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct DepthNoiseOptions {
  // Standard deviation of the log scale of an image [1].
  double log_scale_stddev = 0;
  // Standard deviation of the smooth log-depth error over an image [1].
  double log_field_stddev = 0;
  // Standard deviation of the independent log-depth error of a sample [1].
  double log_noise_stddev = 0;
  // If positive, that error has Student's t distribution with so many degrees
  // of freedom, scaled by log_noise_stddev: the fewer, the heavier its tails.
  int noise_degrees_of_freedom = 0;
  // Share of samples, in [0, 1), off by a factor between 1.5 and 4.
  double outlier_ratio = 0;
  // A sample that lies nearer than this [px of the camera's image] to one of
  // another surface has a depth between the two; 0 leaves edges sharp.
  double edge_radius_px = 0;
  // Weight, in [0, 1], of a smooth map that has nothing to do with the scene,
  // against the true log depth.
  double unrelated_weight = 0;

  bool IsValid(std::string* error) const;
};

// Named errors, each with a scale drift of 20 %, but for "exact" and
// "network":
// - exact: none;
// - network: as those of good metric networks (scale 10 %, field 2 %, noise
//   1 %);
// - drift: the scale alone;
// - field: smooth errors of 10 %;
// - heavy_tails: noise of 5 % with two degrees of freedom and 10 % outliers;
// - edge_bleeding: edges blurred within 8 px, noise of 1 %;
// - useless: maps unrelated to the scene.
// Throws std::runtime_error on another name.
DepthNoiseOptions DepthModelFromName(const std::string& name);
// "exact, network, ... or useless".
std::string DepthModelNames();

// Scales of `num_images` depth maps with median log scale zero, so that a
// model in units of the median depth map is metric.
std::vector<double> SynthesizeDepthScales(double log_scale_stddev,
                                          int num_images,
                                          uint32_t random_seed);

// Samples of the true depth map of one image.
struct DepthSamples {
  Eigen::Vector2d image_size_px;
  std::vector<Eigen::Vector2d> xys_px;
  std::vector<double> depths;  // 0 is unknown
};

// Priors of samples, by
//   depth = scale * prior_depth * exp(-error(x, y)),
// in units of 1 / scale. Unknown depth stays unknown, all others are positive.
// Deterministic in seed and image id; O(samples).
std::vector<float> SynthesizePriorDepths(const DepthNoiseOptions& options,
                                         double scale,
                                         const DepthSamples& samples,
                                         uint32_t random_seed,
                                         uint32_t image_id);

// The same for the true depth map of an image, in place.
void AddDepthErrors(const DepthNoiseOptions& options,
                    const colmap::Camera& camera,
                    double scale,
                    uint32_t random_seed,
                    colmap::image_t image_id,
                    DepthMap* depth_map);

}  // namespace dgsfm
