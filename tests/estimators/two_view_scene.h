// Synthetic image pairs with exact truth for the tests of two-view estimators.

#pragma once

#include "estimators/two_view/two_view_geometry_depth.h"
#include "estimators/two_view/two_view_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace dgsfm {

struct TwoViewSceneOptions {
  int num_matches = 400;
  double outlier_ratio = 0.3;
  double point_stddev_px = 1;
  // Log-depth noise: this much per point, and as much in a smooth field over
  // each map.
  double log_depth_stddev = 0.1;
  // Share of depths that are off by a factor of about two.
  double bad_depth_ratio = 0.05;
  bool shared_focal = false;
  double max_rotation_deg = 30;
  // Camera 2 circles around the scene; otherwise it turns on the spot. Besides
  // it moves by about baseline_ratio times the scene's distance.
  bool orbit = true;
  double baseline_ratio = 0.15;
  // All points on one plane.
  bool planar = false;
};

struct TwoViewScene {
  static constexpr double kWidth = 1600;
  static constexpr double kHeight = 1066;

  TwoViewDepthInput input;  // focal lengths: the guess 1.2 * width
  TwoViewModel truth;
  std::vector<bool> is_inlier;
};

// Smooth error of a depth map over the image, as depth networks have it.
class DepthErrorField {
 public:
  template <typename Normal>
  DepthErrorField(double stddev, const Normal& normal) {
    for (double& c : coefficients_) c = stddev * normal();
  }
  double operator()(const Eigen::Vector2d& x) const {
    const double u = 2 * x.x() / TwoViewScene::kWidth;
    const double v = 2 * x.y() / TwoViewScene::kHeight;
    return 0.5 * (coefficients_[0] * u + coefficients_[1] * v) +
           coefficients_[2] * u * v + coefficients_[3] * std::sin(3 * u) / 3;
  }

 private:
  std::array<double, 4> coefficients_;
};

inline TwoViewScene CreateTwoViewScene(const TwoViewSceneOptions& options,
                                       uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(random);
  };
  const auto normal = [&] {
    return std::normal_distribution<double>(0, 1)(random);
  };
  const auto random_vector = [&](double x, double y, double z) {
    const double a = x * normal();
    const double b = y * normal();
    return Eigen::Vector3d(a, b, z * normal());
  };
  const auto random_pixel = [&] {
    const double x = uniform(-0.5, 0.5) * TwoViewScene::kWidth;
    return Eigen::Vector2d(x, uniform(-0.5, 0.5) * TwoViewScene::kHeight);
  };
  const auto is_visible = [](const Eigen::Vector2d& x) {
    return std::abs(x.x()) < TwoViewScene::kWidth / 2 &&
           std::abs(x.y()) < TwoViewScene::kHeight / 2;
  };
  const size_t num_inliers = static_cast<size_t>(
      std::lround(options.num_matches * (1 - options.outlier_ratio)));

  while (true) {  // until the views overlap enough
    TwoViewScene scene;
    TwoViewModel& truth = scene.truth;
    DepthMatches& matches = scene.input.matches;
    truth.focal1 = uniform(900, 1900);
    truth.focal2 = options.shared_focal ? truth.focal1 : uniform(900, 1900);
    truth.scale = std::exp(uniform(-std::log(2.0), std::log(2.0)));
    const double angle =
        uniform(0.2, 1) * options.max_rotation_deg * M_PI / 180;
    truth.rotation =
        Eigen::AngleAxisd(angle, random_vector(1, 1, 0.5).normalized())
            .toRotationMatrix();
    const double distance = uniform(4, 9);
    const Eigen::Vector3d center(0, 0, distance);
    const Eigen::Vector3d offset = options.baseline_ratio * distance *
                                   uniform(0.4, 1.6) *
                                   random_vector(1, 0.4, 0.6).normalized();
    truth.translation = -truth.rotation * offset;
    if (options.orbit) truth.translation += center - truth.rotation * center;
    const Eigen::Vector3d plane_normal =
        random_vector(0.4, 0.4, 0) - Eigen::Vector3d::UnitZ();
    const DepthErrorField field1(options.log_depth_stddev, normal);
    const DepthErrorField field2(options.log_depth_stddev, normal);
    const auto noisy_depth = [&](double depth,
                                 const DepthErrorField& field,
                                 const Eigen::Vector2d& x) {
      double error = field(x) + options.log_depth_stddev * normal();
      if (uniform(0, 1) < options.bad_depth_ratio) error += 0.7 * normal();
      return depth * std::exp(error);
    };
    const auto noisy_point = [&](const Eigen::Vector2d& x) {
      return Eigen::Vector2d(x + options.point_stddev_px *
                                     random_vector(1, 1, 0).head<2>());
    };

    for (int i = 0; i < 20000 && matches.points1.size() < num_inliers; ++i) {
      const Eigen::Vector2d x1 = random_pixel();
      const Eigen::Vector3d ray(
          x1.x() / truth.focal1, x1.y() / truth.focal1, 1);
      double z1 = distance * std::exp(0.45 * normal());
      if (options.planar) {
        z1 = plane_normal.dot(center) / plane_normal.dot(ray);
      }
      if (!(z1 > 0.1 && z1 < 100)) continue;
      const Eigen::Vector3d point2 =
          truth.rotation * (z1 * ray) + truth.translation;
      if (point2.z() < 0.3) continue;
      const Eigen::Vector2d x2 = truth.focal2 * point2.head<2>() / point2.z();
      if (!is_visible(x2)) continue;
      matches.depths1.push_back(noisy_depth(z1, field1, x1));
      matches.depths2.push_back(noisy_depth(point2.z(), field2, x2) /
                                truth.scale);
      matches.points1.push_back(noisy_point(x1));
      matches.points2.push_back(noisy_point(x2));
    }
    if (matches.points1.size() < num_inliers) continue;
    scene.is_inlier.assign(num_inliers, true);
    scene.is_inlier.resize(options.num_matches, false);
    for (size_t i = num_inliers; i < scene.is_inlier.size(); ++i) {
      matches.points1.push_back(random_pixel());
      matches.points2.push_back(random_pixel());
      matches.depths1.push_back(distance * std::exp(0.45 * normal()));
      matches.depths2.push_back(distance * std::exp(0.45 * normal()) /
                                truth.scale);
    }
    scene.input.focal_case =
        options.shared_focal ? FocalCase::SHARED : FocalCase::TWO;
    scene.input.focal_length1_px = 1.2 * TwoViewScene::kWidth;
    scene.input.focal_length2_px = 1.2 * TwoViewScene::kWidth;
    scene.input.image_size1_px = TwoViewScene::kWidth;
    scene.input.image_size2_px = TwoViewScene::kWidth;
    scene.input.seed = seed;
    return scene;
  }
}

// The same with the focal lengths that are known in `focal_case` in the input.
inline TwoViewScene CreateTwoViewScene(TwoViewSceneOptions options,
                                       FocalCase focal_case,
                                       uint64_t seed) {
  options.shared_focal = focal_case == FocalCase::SHARED;
  TwoViewScene scene = CreateTwoViewScene(options, seed);
  scene.input.focal_case = focal_case;
  if (focal_case == FocalCase::KNOWN || focal_case == FocalCase::ONE_SIDED1) {
    scene.input.focal_length1_px = scene.truth.focal1;
  }
  if (focal_case == FocalCase::KNOWN || focal_case == FocalCase::ONE_SIDED2) {
    scene.input.focal_length2_px = scene.truth.focal2;
  }
  return scene;
}

inline void RemoveDepth(TwoViewDepthInput* input) {
  for (double& depth : input->matches.depths1) depth = 0;
}

// Depth maps that belong to other images.
inline void PermuteDepth(TwoViewDepthInput* input) {
  std::mt19937_64 random(input->seed);
  std::shuffle(
      input->matches.depths1.begin(), input->matches.depths1.end(), random);
  std::shuffle(
      input->matches.depths2.begin(), input->matches.depths2.end(), random);
}

struct TwoViewErrors {
  double rotation_deg = 180;
  double translation_deg = 180;
  double focal_ratio = 1;  // larger of |f / f_true - 1|
  double log_scale = 1;

  double PoseDeg() const { return std::max(rotation_deg, translation_deg); }
};

inline TwoViewErrors CompareWithTruth(const TwoViewDepthResult& result,
                                      const TwoViewModel& truth) {
  constexpr double kDegPerRad = 180 / M_PI;
  TwoViewErrors errors;
  if (!result.success) return errors;
  errors.rotation_deg =
      kDegPerRad * result.cam2_from_cam1.rotation.angularDistance(
                       Eigen::Quaterniond(truth.rotation));
  const Eigen::Vector3d& t = result.cam2_from_cam1.translation;
  // A translation of zero has no direction.
  errors.translation_deg =
      truth.translation.norm() < 1e-9
          ? 0
          : kDegPerRad * std::atan2(t.cross(truth.translation).norm(),
                                    t.dot(truth.translation));
  errors.focal_ratio =
      std::max(std::abs(result.focal_length1_px / truth.focal1 - 1),
               std::abs(result.focal_length2_px / truth.focal2 - 1));
  if (result.has_scale) {
    errors.log_scale = std::abs(std::log(result.scale_1_from_2 / truth.scale));
  }
  return errors;
}

// Area under the recall curve of errors up to `threshold`, in percent.
inline double AreaUnderRecall(const std::vector<double>& errors,
                              double threshold) {
  double area = 0;
  for (const double error : errors) area += std::max(0.0, threshold - error);
  return 100 * area / (threshold * errors.size());
}

inline double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace dgsfm
