#include "colmap_ext/synthetic/depth_noise.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {

namespace {

constexpr uint32_t kDepthNoisePurpose = 100;
constexpr uint32_t kDepthScalePurpose = 101;

}  // namespace

bool DepthNoiseOptions::IsValid(std::string* error) const {
  const auto check = [error](const char* name, double value, double bound) {
    if (value >= 0 && value < bound) return true;
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be in [0, " + std::to_string(bound) + ")";
    return false;
  };
  // Errors beyond a factor of e^3 are no depth priors any more.
  return check("log_scale_stddev", log_scale_stddev, 3) &&
         check("log_field_stddev", log_field_stddev, 3) &&
         check("log_noise_stddev", log_noise_stddev, 3) &&
         check("outlier_ratio", outlier_ratio, 1);
}

std::vector<double> SynthesizeDepthScales(double log_scale_stddev,
                                          int num_images,
                                          uint32_t random_seed) {
  RandomStream random(random_seed, kDepthScalePurpose);
  std::vector<double> log_scales(num_images);
  for (double& log_scale : log_scales) {
    log_scale = log_scale_stddev * random.Normal();
  }
  if (num_images == 0) return log_scales;
  std::vector<double> sorted = log_scales;
  std::sort(sorted.begin(), sorted.end());
  const double median =
      0.5 * (sorted[(num_images - 1) / 2] + sorted[num_images / 2]);
  std::vector<double> scales;
  for (const double log_scale : log_scales) {
    scales.push_back(std::exp(log_scale - median));
  }
  return scales;
}

DepthNoise::DepthNoise(const DepthNoiseOptions& options,
                       double scale,
                       uint32_t random_seed,
                       uint32_t image_id)
    : options_(options),
      scale_(scale),
      random_(random_seed, kDepthNoisePurpose, image_id) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(scale > 0) << "scale = " << scale;
  for (Wave& wave : waves_) {
    wave.frequency = {random_.Uniform(0.25, 1.5), random_.Uniform(-1.5, 1.5)};
    wave.phase = random_.Uniform(0, 2 * M_PI);
  }
}

double DepthNoise::PriorDepth(double depth, const Eigen::Vector2d& xy) {
  if (depth == 0) return 0;
  double field = 0;
  for (const Wave& wave : waves_) {
    field += std::cos(2 * M_PI * wave.frequency.dot(xy) + wave.phase);
  }
  // A cosine of random phase has variance 1 / 2.
  double log_error =
      options_.log_field_stddev * field * std::sqrt(2. / waves_.size());
  log_error += options_.log_noise_stddev * random_.Normal();
  if (random_.Uniform() < options_.outlier_ratio) {
    const double sign = random_.Uniform() < 0.5 ? -1 : 1;
    log_error += sign * random_.Uniform(std::log(1.5), std::log(4.));
  }
  return depth / scale_ * std::exp(log_error);
}

}  // namespace dgsfm
