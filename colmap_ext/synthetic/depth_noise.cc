#include "colmap_ext/synthetic/depth_noise.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/random_stream.h"
#include "colmap_ext/synthetic/synthetic_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

enum Purpose : uint32_t {
  NOISE = 100,
  SCALES = 101,
  EDGES = 102,
  UNRELATED = 103,
};

// Errors beyond a factor of e^3 are no depth priors any more.
constexpr double kMaxLogError = 3;
// Depths that differ by more are those of two surfaces.
constexpr double kEdgeLogStep = 0.05;
// Unrelated maps show distances as those of most photos: about 10 m, within a
// factor of e from map to map and within each.
constexpr double kUnrelatedDepth = 10;
constexpr double kUnrelatedLogStddev = 0.5;

// A smooth function over an image with zero mean and unit variance.
class RandomField {
 public:
  explicit RandomField(RandomStream* random) {
    for (Wave& wave : waves_) {
      wave.frequency = {random->Uniform(0.25, 1.5), random->Uniform(-1.5, 1.5)};
      wave.phase = random->Uniform(0, 2 * M_PI);
    }
  }

  // At an image position divided by width and height.
  double operator()(const Eigen::Vector2d& xy) const {
    double sum = 0;
    for (const Wave& wave : waves_) {
      sum += std::cos(2 * M_PI * wave.frequency.dot(xy) + wave.phase);
    }
    // A cosine of random phase has variance 1 / 2.
    return sum * std::sqrt(2. / waves_.size());
  }

 private:
  struct Wave {
    Eigen::Vector2d frequency;  // [1 / image width or height]
    double phase;               // [rad]
  };
  std::array<Wave, 4> waves_;
};

// Samples in square cells, so that neighbours are found without search.
class SampleGrid {
 public:
  SampleGrid(const DepthSamples& samples, double cell_size)
      : samples_(samples),
        cell_size_(cell_size),
        num_columns_(CellOf(samples.image_size_px.x()) + 1),
        num_rows_(CellOf(samples.image_size_px.y()) + 1),
        cells_(size_t(num_columns_) * num_rows_) {
    for (size_t i = 0; i < samples.xys_px.size(); ++i) {
      if (samples.depths[i] == 0) continue;
      const Eigen::Vector2d& xy = samples.xys_px[i];
      cells_[CellOf(xy.y()) * num_columns_ + CellOf(xy.x())].push_back(i);
    }
  }

  // Depth of the nearest sample of another surface, nearer than a cell; 0 if
  // there is none.
  double OtherSurfaceDepth(size_t idx) const {
    const Eigen::Vector2d& xy = samples_.xys_px[idx];
    const double log_depth = std::log(samples_.depths[idx]);
    double min_sq_distance = cell_size_ * cell_size_;
    double other_depth = 0;
    const int x = CellOf(xy.x()), y = CellOf(xy.y());
    for (int v = std::max(0, y - 1); v < std::min(num_rows_, y + 2); ++v) {
      for (int u = std::max(0, x - 1); u < std::min(num_columns_, x + 2); ++u) {
        for (const size_t other : cells_[v * num_columns_ + u]) {
          const double sq_distance =
              (samples_.xys_px[other] - xy).squaredNorm();
          const double depth = samples_.depths[other];
          if (sq_distance < min_sq_distance &&
              std::abs(std::log(depth) - log_depth) > kEdgeLogStep) {
            min_sq_distance = sq_distance;
            other_depth = depth;
          }
        }
      }
    }
    return other_depth;
  }

 private:
  int CellOf(double coordinate) const {
    return static_cast<int>(coordinate / cell_size_);
  }

  const DepthSamples& samples_;
  double cell_size_;
  int num_columns_;
  int num_rows_;
  std::vector<std::vector<size_t>> cells_;
};

std::vector<double> BleedEdges(const DepthSamples& samples,
                               double radius,
                               RandomStream random) {
  std::vector<double> depths = samples.depths;
  if (radius == 0) return depths;
  const SampleGrid grid(samples, radius);
  for (size_t i = 0; i < depths.size(); ++i) {
    if (depths[i] == 0) continue;
    const double weight = random.Uniform();
    const double other_depth = grid.OtherSurfaceDepth(i);
    if (other_depth > 0) depths[i] += weight * (other_depth - depths[i]);
  }
  return depths;
}

double DrawNoise(int degrees_of_freedom, RandomStream* random) {
  const double normal = random->Normal();
  if (degrees_of_freedom == 0) return normal;
  double chi_squared = std::numeric_limits<double>::min();
  for (int i = 0; i < degrees_of_freedom; ++i) {
    const double value = random->Normal();
    chi_squared += value * value;
  }
  return normal / std::sqrt(chi_squared / degrees_of_freedom);
}

const std::vector<std::pair<std::string, DepthNoiseOptions>>& DepthModels() {
  static const auto* const models = [] {
    DepthNoiseOptions network;
    network.log_scale_stddev = 0.1;
    network.log_field_stddev = 0.02;
    network.log_noise_stddev = 0.01;
    DepthNoiseOptions drift;
    drift.log_scale_stddev = 0.2;
    DepthNoiseOptions field = drift;
    field.log_field_stddev = 0.1;
    DepthNoiseOptions heavy_tails = drift;
    heavy_tails.log_noise_stddev = 0.05;
    heavy_tails.noise_degrees_of_freedom = 2;
    heavy_tails.outlier_ratio = 0.1;
    DepthNoiseOptions edge_bleeding = drift;
    edge_bleeding.log_noise_stddev = 0.01;
    edge_bleeding.edge_radius_px = 8;
    DepthNoiseOptions useless = drift;
    useless.unrelated_weight = 1;
    return new std::vector<std::pair<std::string, DepthNoiseOptions>>{
        {"exact", DepthNoiseOptions()},
        {"network", network},
        {"drift", drift},
        {"field", field},
        {"heavy_tails", heavy_tails},
        {"edge_bleeding", edge_bleeding},
        {"useless", useless}};
  }();
  return *models;
}

}  // namespace

bool DepthNoiseOptions::IsValid(std::string* error) const {
  const auto check = [error](const char* name, double value, double bound) {
    if (value >= 0 && value < bound) return true;
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be in [0, " + std::to_string(bound) + ")";
    return false;
  };
  if (!(unrelated_weight >= 0 && unrelated_weight <= 1)) {
    *error = "unrelated_weight = " + std::to_string(unrelated_weight) +
             " must be in [0, 1]";
    return false;
  }
  return check("log_scale_stddev", log_scale_stddev, kMaxLogError) &&
         check("log_field_stddev", log_field_stddev, kMaxLogError) &&
         check("log_noise_stddev", log_noise_stddev, kMaxLogError) &&
         check("noise_degrees_of_freedom", noise_degrees_of_freedom, 100) &&
         check("outlier_ratio", outlier_ratio, 1) &&
         check("edge_radius_px", edge_radius_px, 1000);
}

DepthNoiseOptions DepthModelFromName(const std::string& name) {
  for (const auto& [model_name, options] : DepthModels()) {
    if (name == model_name) return options;
  }
  throw std::runtime_error("depth model '" + name + "' must be " +
                           DepthModelNames());
}

std::string DepthModelNames() {
  std::string names;
  for (const auto& [name, options] : DepthModels()) {
    if (!names.empty()) {
      names += name == DepthModels().back().first ? " or " : ", ";
    }
    names += name;
  }
  return names;
}

std::vector<double> SynthesizeDepthScales(double log_scale_stddev,
                                          int num_images,
                                          uint32_t random_seed) {
  RandomStream random(random_seed, SCALES);
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

std::vector<float> SynthesizePriorDepths(const DepthNoiseOptions& options,
                                         double scale,
                                         const DepthSamples& samples,
                                         uint32_t random_seed,
                                         uint32_t image_id) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(scale > 0) << "scale = " << scale;
  DGSFM_CHECK(samples.xys_px.size() == samples.depths.size());
  const std::vector<double> depths =
      BleedEdges(samples,
                 options.edge_radius_px,
                 RandomStream(random_seed, EDGES, image_id));
  RandomStream unrelated_random(random_seed, UNRELATED, image_id);
  const double unrelated_log_depth =
      std::log(kUnrelatedDepth) +
      kUnrelatedLogStddev * unrelated_random.Normal();
  const RandomField unrelated_field(&unrelated_random);
  RandomStream random(random_seed, NOISE, image_id);
  const RandomField field(&random);
  std::vector<float> priors;
  priors.reserve(depths.size());
  for (size_t i = 0; i < depths.size(); ++i) {
    if (depths[i] == 0) {
      priors.push_back(0);
      continue;
    }
    const Eigen::Vector2d xy =
        samples.xys_px[i].cwiseQuotient(samples.image_size_px);
    double log_error = options.log_field_stddev * field(xy);
    log_error += options.log_noise_stddev *
                 DrawNoise(options.noise_degrees_of_freedom, &random);
    if (random.Uniform() < options.outlier_ratio) {
      const double sign = random.Uniform() < 0.5 ? -1 : 1;
      log_error += sign * random.Uniform(std::log(1.5), std::log(4.));
    }
    log_error = std::clamp(log_error, -kMaxLogError, kMaxLogError);
    if (options.unrelated_weight > 0) {
      const double unrelated_log =
          unrelated_log_depth + kUnrelatedLogStddev * unrelated_field(xy);
      log_error +=
          options.unrelated_weight * (unrelated_log - std::log(depths[i]));
    }
    priors.push_back(
        static_cast<float>(depths[i] / scale * std::exp(log_error)));
  }
  return priors;
}

void AddDepthErrors(const DepthNoiseOptions& options,
                    const colmap::Camera& camera,
                    double scale,
                    uint32_t random_seed,
                    colmap::image_t image_id,
                    DepthMap* depth_map) {
  DepthSamples samples;
  samples.image_size_px = ImageSize(camera);
  const Eigen::Vector2d pixel_size(
      samples.image_size_px.x() / depth_map->width,
      samples.image_size_px.y() / depth_map->height);
  for (int y = 0; y < depth_map->height; ++y) {
    for (int x = 0; x < depth_map->width; ++x) {
      samples.xys_px.push_back(
          Eigen::Vector2d(x + 0.5, y + 0.5).cwiseProduct(pixel_size));
    }
  }
  samples.depths.assign(depth_map->values.begin(), depth_map->values.end());
  depth_map->values =
      SynthesizePriorDepths(options, scale, samples, random_seed, image_id);
}

}  // namespace dgsfm
