#include "colmap_ext/synthetic/depth_noise.h"

#include "colmap_ext/synthetic/random_stream.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr uint32_t kSeed = 1;
constexpr uint32_t kImageId = 2;

// A wall of 10 m, and of 20 m in the right half, seen at random positions.
DepthSamples Step(int num_samples) {
  RandomStream random(kSeed, 1000);
  DepthSamples samples;
  samples.image_size_px = {800, 600};
  for (int i = 0; i < num_samples; ++i) {
    const double x = random.Uniform(0, 800);
    samples.xys_px.emplace_back(x, random.Uniform(0, 600));
    samples.depths.push_back(x < 400 ? 10 : 20);
  }
  return samples;
}

std::vector<double> LogErrors(const DepthNoiseOptions& options,
                              const DepthSamples& samples) {
  const std::vector<float> priors =
      SynthesizePriorDepths(options, 1, samples, kSeed, kImageId);
  std::vector<double> errors;
  for (size_t i = 0; i < priors.size(); ++i) {
    errors.push_back(std::log(priors[i] / samples.depths[i]));
  }
  return errors;
}

// Share of values beyond `bound` in size.
double ShareBeyond(const std::vector<double>& values, double bound) {
  return double(std::count_if(values.begin(),
                              values.end(),
                              [&](double v) { return std::abs(v) > bound; })) /
         values.size();
}

TEST(DepthNoise, ExactModelOnlyScales) {
  DepthSamples samples = Step(10);
  samples.depths[3] = 0;
  const std::vector<float> priors = SynthesizePriorDepths(
      DepthModelFromName("exact"), 2, samples, kSeed, kImageId);
  for (size_t i = 0; i < priors.size(); ++i) {
    EXPECT_FLOAT_EQ(priors[i], samples.depths[i] / 2);
  }
}

TEST(DepthNoise, ModelsAreDeterministicInSeedAndImage) {
  const DepthSamples samples = Step(500);
  for (const char* name :
       {"network", "field", "heavy_tails", "edge_bleeding", "useless"}) {
    const DepthNoiseOptions options = DepthModelFromName(name);
    const auto priors =
        SynthesizePriorDepths(options, 1, samples, kSeed, kImageId);
    EXPECT_EQ(priors,
              SynthesizePriorDepths(options, 1, samples, kSeed, kImageId));
    EXPECT_NE(priors,
              SynthesizePriorDepths(options, 1, samples, kSeed, kImageId + 1));
    for (const float prior : priors) EXPECT_TRUE(prior > 0 && prior < 1e4);
  }
  EXPECT_THROW(DepthModelFromName("wrong"), std::runtime_error);
}

TEST(DepthNoise, FewDegreesOfFreedomMakeHeavyTails) {
  DepthNoiseOptions options;
  options.log_noise_stddev = 0.05;
  const DepthSamples samples = Step(20000);
  // Three standard deviations: 0.27 % of a normal distribution, 9.5 % of
  // Student's with two degrees of freedom. Five sigma of the draw: 0.18 %, 1 %.
  EXPECT_NEAR(ShareBeyond(LogErrors(options, samples), 0.15), 0.0027, 0.0018);
  options.noise_degrees_of_freedom = 2;
  EXPECT_NEAR(ShareBeyond(LogErrors(options, samples), 0.15), 0.095, 0.01);
}

TEST(DepthNoise, EdgesBleedWithinTheRadius) {
  DepthNoiseOptions options;
  options.edge_radius_px = 10;
  const DepthSamples samples = Step(20000);
  const std::vector<float> priors =
      SynthesizePriorDepths(options, 1, samples, kSeed, kImageId);
  int num_bled = 0, num_near = 0;
  for (size_t i = 0; i < priors.size(); ++i) {
    const double distance = std::abs(samples.xys_px[i].x() - 400);
    EXPECT_GE(priors[i], 10);
    EXPECT_LE(priors[i], 20);
    const double change = std::abs(priors[i] - samples.depths[i]);
    if (distance >= 10) {
      EXPECT_EQ(change, 0);
    } else if (distance < 5) {
      ++num_near;
      num_bled += change > 1;
    }
  }
  // Nine of ten weights move the depth by more than a tenth of the step; a
  // circle of 10 px around them reaches 5 px and more across the edge, where
  // it holds some five samples.
  EXPECT_GT(num_bled, 0.75 * num_near);
}

TEST(DepthNoise, UselessMapsTellNothingOfTheScene) {
  const DepthSamples samples = Step(200);
  DepthSamples flat = samples;
  std::fill(flat.depths.begin(), flat.depths.end(), 5);
  const DepthNoiseOptions options = DepthModelFromName("useless");
  const auto priors =
      SynthesizePriorDepths(options, 1, samples, kSeed, kImageId);
  const auto flat_priors =
      SynthesizePriorDepths(options, 1, flat, kSeed, kImageId);
  for (size_t i = 0; i < priors.size(); ++i) {
    EXPECT_NEAR(priors[i] / flat_priors[i], 1, 1e-5);  // floats
  }
  // They are smooth and not flat.
  const auto [min, max] = std::minmax_element(priors.begin(), priors.end());
  EXPECT_GT(*max / *min, 1.5);
}

TEST(DepthNoise, InvalidOptionsAreNamed) {
  DepthNoiseOptions options;
  options.unrelated_weight = 1.1;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_NE(error.find("unrelated_weight"), std::string::npos);
  options = {};
  options.edge_radius_px = -1;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_NE(error.find("edge_radius_px"), std::string::npos);
}

}  // namespace
}  // namespace dgsfm
