// Errors of depth priors as those of monocular networks: a wrong scale per
// image, an error that varies smoothly over the image, noise per pixel and
// gross errors.

#pragma once

#include "colmap_ext/synthetic/random_stream.h"

#include <array>
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
  // Share of samples, in [0, 1), off by a factor between 1.5 and 4.
  double outlier_ratio = 0;

  bool IsValid(std::string* error) const;
};

// Scales of `num_images` depth maps with median log scale zero, so that a
// model in units of the median depth map is metric.
std::vector<double> SynthesizeDepthScales(double log_scale_stddev,
                                          int num_images,
                                          uint32_t random_seed);

// The errors of one image:
//   depth = scale * prior_depth * exp(-error(x, y)).
// Deterministic in seed and image id; samples draw from one stream in order.
class DepthNoise {
 public:
  // `scale` > 0 [depth unit per prior unit].
  DepthNoise(const DepthNoiseOptions& options,
             double scale,
             uint32_t random_seed,
             uint32_t image_id);

  // Prior of a true depth at `xy`, the image position divided by width and
  // height. Unknown depth (0) stays unknown.
  double PriorDepth(double depth, const Eigen::Vector2d& xy);

 private:
  struct Wave {
    Eigen::Vector2d frequency;  // [1 / image width or height]
    double phase;               // [rad]
  };

  DepthNoiseOptions options_;
  double scale_;
  std::array<Wave, 4> waves_;
  RandomStream random_;
};

}  // namespace dgsfm
