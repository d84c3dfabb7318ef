#include "estimators/multi_view_depth.h"

#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kWidth = 80;
constexpr int kHeight = 60;

// The wall z = 5 + 0.5 x and, before it, a square plate at z = 3 around x = 0.
double TrueDepth(const Eigen::Vector3d& center, const Eigen::Vector3d& ray) {
  const double plate = 3 - center.z();
  const Eigen::Vector3d on_plate = center + plate * ray;
  if (std::abs(on_plate.x()) < 0.5 && std::abs(on_plate.y()) < 0.5) {
    return plate;
  }
  // center.z + d = 5 + 0.5 (center.x + d ray.x)
  return (5 + 0.5 * center.x() - center.z()) / (1 - 0.5 * ray.x());
}

colmap::Camera CreateCamera() {
  colmap::Camera camera;
  camera.InitializeWithName("SIMPLE_RADIAL", 70, kWidth, kHeight);
  camera.SetParams({70, kWidth / 2.0, kHeight / 2.0, 0.05});
  return camera;
}

using Error = std::function<double(int x, int y)>;

// A view from x that looks along z, whose depths are off by these factors.
DepthView CreateView(double x, double stddev, const Error& error) {
  const colmap::Camera camera = CreateCamera();
  DepthMap map = {kWidth, kHeight, DepthUnit::METRIC, {}};
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const Eigen::Vector3d ray =
          camera.ImageToWorld({u + 0.5, v + 0.5}).homogeneous();
      map.values.push_back(
          static_cast<float>(TrueDepth({x, 0, 0}, ray) * error(u, v)));
    }
  }
  return DepthView(camera,
                   Rigid3d(Eigen::Quaterniond::Identity(), {-x, 0, 0}),
                   std::move(map),
                   stddev);
}

double NoError(int, int) { return 1; }

Error Noise(int seed, double stddev) {
  return [random = std::mt19937(seed),
          normal = std::normal_distribution<double>(0, stddev)](
             int, int) mutable { return std::exp(normal(random)); };
}

const std::vector<double> kPlaces = {-1.2, -0.6, 0.6, 1.2};

std::vector<DepthView> CreateNeighbors(double stddev) {
  std::vector<DepthView> views;
  for (size_t i = 0; i < kPlaces.size(); ++i) {
    views.push_back(
        CreateView(kPlaces[i], stddev, Noise(static_cast<int>(i), stddev)));
  }
  return views;
}

std::vector<const DepthView*> Pointers(const std::vector<DepthView>& views) {
  std::vector<const DepthView*> pointers;
  for (const DepthView& view : views) pointers.push_back(&view);
  return pointers;
}

// Median error of the known depths in a range of columns.
double MedianError(const DepthMap& map, int begin = 0, int end = kWidth) {
  const DepthMap truth = CreateView(0, 1, NoError).Map();
  std::vector<double> errors;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = begin; x < end; ++x) {
      if (map.At(x, y) <= 0) continue;
      errors.push_back(std::abs(map.At(x, y) / truth.At(x, y) - 1));
    }
  }
  return Median(std::move(errors));
}

TEST(MultiViewDepth, ViewsAverageTheirNoise) {
  const DepthView view = CreateView(0, 0.01, Noise(9, 0.01));
  const std::vector<DepthView> neighbors = CreateNeighbors(0.01);
  const RefinedDepth refined = RefineDepth(view, Pointers(neighbors), {}, 2);
  // Five views have 0.45 of the noise of one, and the sides are seen by fewer.
  EXPECT_LT(MedianError(refined.depth_map), 0.5 * MedianError(view.Map()));
  EXPECT_GT(refined.agreeing_ratio, 0.9);
  // The border of the plate.
  EXPECT_LT(refined.dropped_ratio, 0.1);
  const RefinedDepth serial = RefineDepth(view, Pointers(neighbors), {}, 1);
  EXPECT_EQ(serial.depth_map.values, refined.depth_map.values);
  EXPECT_EQ(serial.confidence, refined.confidence);
}

TEST(MultiViewDepth, PreciseMapsCountMore) {
  // The whole map is too far, on a wall that is oblique to the rays.
  const DepthView view = CreateView(0, 0.02, [](int, int) { return 1.01; });
  const std::vector<DepthView> neighbors = CreateNeighbors(1e-4);
  const RefinedDepth refined = RefineDepth(view, Pointers(neighbors), {}, 1);
  EXPECT_NEAR(MedianError(view.Map()), 0.01, 1e-6);
  EXPECT_LT(MedianError(refined.depth_map), 5e-4);
}

TEST(MultiViewDepth, WhatIsHiddenIsNoContradiction) {
  const DepthView view = CreateView(0, 0.01, NoError);
  // From the side the plate hides what is beside it here.
  const DepthView neighbor = CreateView(0.6, 0.01, NoError);
  const RefinedDepth refined = RefineDepth(view, {&neighbor}, {}, 1);
  int num_silent = 0;
  for (int x = 10; x < kWidth - 15; ++x) {
    const float confidence = refined.confidence[kHeight / 2 * kWidth + x];
    // Right at the plate's sides depth is none of a surface.
    const bool is_beside_plate =
        std::abs(x + 0.5 - kWidth / 2.0) > 70 * 0.5 / 3 + 1.5;
    if (is_beside_plate) {
      EXPECT_GE(confidence, 0.5) << x;
    }
    num_silent += confidence == 0.5f;
  }
  // The plate is 12 px away from where it is in front of the wall.
  EXPECT_GT(num_silent, 3);
}

// A spot of the wall with another depth.
Error Spot(double factor) {
  return [factor](int x, int y) {
    return x >= 60 && x < 68 && y >= 10 && y < 18 ? factor : 1;
  };
}

TEST(MultiViewDepth, WrongDepthIsDropped) {
  const std::vector<DepthView> neighbors = CreateNeighbors(0.002);
  // Neighbours see through what is too near, and this view through their wall.
  for (const double factor : {0.8, 1.3}) {
    const DepthView view = CreateView(0, 0.002, Spot(factor));
    const RefinedDepth refined = RefineDepth(view, Pointers(neighbors), {}, 1);
    const auto count_dropped = [&](const RefinedDepth& depth) {
      int count = 0;
      for (int y = 11; y < 17; ++y) {
        for (int x = 61; x < 67; ++x) count += depth.depth_map.At(x, y) == 0;
      }
      return count;
    };
    EXPECT_GE(count_dropped(refined), 0.9 * 6 * 6) << factor;
    EXPECT_LT(refined.confidence[14 * kWidth + 64], 0.5);
    MultiViewDepthOptions options;
    options.min_confidence = 0;
    const RefinedDepth marked =
        RefineDepth(view, Pointers(neighbors), options, 1);
    EXPECT_EQ(count_dropped(marked), 0);
    EXPECT_EQ(marked.dropped_ratio, 0);
    EXPECT_EQ(marked.confidence, refined.confidence);
  }
}

TEST(MultiViewDepth, WithoutNeighborsDepthStays) {
  const DepthView view = CreateView(0, 0.01, Noise(1, 0.01));
  const RefinedDepth refined = RefineDepth(view, {}, {}, 1);
  EXPECT_EQ(refined.agreeing_ratio, 0);
  // The wall far from the plate.
  for (int x = 0; x < 20; ++x) {
    EXPECT_EQ(refined.depth_map.At(x, 5), view.Map().At(x, 5));
    EXPECT_EQ(refined.confidence[5 * kWidth + x], 0.5f);
  }
  EXPECT_TRUE(FindAgreements(view, {}, {}).empty());
}

TEST(MultiViewDepth, AgreementsShowTheFieldOfAMap) {
  // One side is too far by 3 %, which is more than the noise.
  const DepthView view =
      CreateView(0, 0.005, [](int x, int) { return 1 + 0.03 * x / kWidth; });
  const std::vector<DepthView> neighbors = CreateNeighbors(0.005);
  const std::vector<DepthCorrespondence> agreements =
      FindAgreements(view, Pointers(neighbors), {});
  ASSERT_GT(agreements.size(), 1000);
  std::vector<double> log_ratios;
  for (const DepthCorrespondence& agreement : agreements) {
    if (agreement.u < 0.7 || agreement.u > 0.8) continue;
    log_ratios.push_back(std::log(agreement.point_depth / agreement.map_depth));
  }
  // The map is off by 2.2 % there; its own depth counts beside two to four
  // others.
  EXPECT_NEAR(Median(log_ratios), -0.019, 0.004);
}

TEST(MultiViewDepth, OptionsNameTheirBounds) {
  MultiViewDepthOptions options;
  std::string error;
  EXPECT_TRUE(options.IsValid(&error));
  options.min_confidence = 1.5;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "min_confidence must be in [0, 1], but is 1.5");
  EXPECT_THROW(CreateView(0, 0, NoError), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
