#include "estimators/optimization/global_positioning.h"

#include "estimators/median.h"
#include "tests/estimators/optimization/plain_positioning.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct SceneOptions {
  int num_cameras = 12;
  int num_points = 200;
  int track_length = 5;
  double noise_deg = 0;
  // Share of observations that are about 30 deg off, and their weight.
  double outlier_ratio = 0;
  double outlier_weight = 1;
  int seed = 1;
};

struct Scene {
  std::vector<Eigen::Vector3d> centers;
  std::vector<Eigen::Vector3d> points;
  std::vector<PositioningObservation> observations;
};

Eigen::Vector3d RandomVector(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return {normal(*random), normal(*random), normal(*random)};
}

// A ring of cameras with radius 5 around points in a cube of side 4, seen by
// neighbouring cameras.
Scene CreateScene(const SceneOptions& options) {
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> uniform;
  Scene scene;
  for (int i = 0; i < options.num_cameras; ++i) {
    const double angle = 2 * M_PI * i / options.num_cameras;
    scene.centers.emplace_back(
        5 * std::cos(angle), 5 * std::sin(angle), uniform(random));
  }
  for (int p = 0; p < options.num_points; ++p) {
    scene.points.emplace_back(4 * uniform(random) - 2,
                              4 * uniform(random) - 2,
                              4 * uniform(random) - 2);
    for (int k = 0; k < options.track_length; ++k) {
      PositioningObservation observation;
      observation.camera = (p + k) % options.num_cameras;
      observation.point = p;
      const bool outlier = uniform(random) < options.outlier_ratio;
      if (outlier) observation.weight = options.outlier_weight;
      const double stddev = outlier ? 0.5 : options.noise_deg * M_PI / 180;
      observation.ray_in_world =
          ((scene.points[p] - scene.centers[observation.camera]).normalized() +
           stddev * RandomVector(&random))
              .normalized();
      scene.observations.push_back(observation);
    }
  }
  return scene;
}

// Displaces all but camera 0 by normally distributed components.
Scene Perturb(Scene scene, double center_stddev, double point_stddev) {
  std::mt19937 random(7);
  for (size_t i = 1; i < scene.centers.size(); ++i) {
    scene.centers[i] += center_stddev * RandomVector(&random);
  }
  for (Eigen::Vector3d& point : scene.points) {
    point += point_stddev * RandomVector(&random);
  }
  return scene;
}

GlobalPositioningOptions TightOptions() {
  GlobalPositioningOptions options;
  options.function_tolerance = 1e-20;
  return options;
}

GlobalPositioningSummary Solve(Scene* scene,
                               const GlobalPositioningOptions& options = {}) {
  return SolveGlobalPositioning(
      scene->observations, 0, options, &scene->centers, &scene->points);
}

struct Errors {
  double rms_center = 0;
  double max_center = 0;
  double max_point = 0;
};

// After the best scaling about camera 0, whose centre is the gauge.
Errors Compare(const Scene& scene, const Scene& truth) {
  const Eigen::Vector3d origin = truth.centers[0];
  double numerator = 0;
  double denominator = 0;
  for (size_t i = 0; i < truth.centers.size(); ++i) {
    const Eigen::Vector3d estimated = scene.centers[i] - origin;
    numerator += estimated.dot(truth.centers[i] - origin);
    denominator += estimated.squaredNorm();
  }
  const double scale = numerator / denominator;
  const auto error = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return (scale * (a - origin) - (b - origin)).norm();
  };
  Errors errors;
  for (size_t i = 0; i < truth.centers.size(); ++i) {
    const double center_error = error(scene.centers[i], truth.centers[i]);
    errors.rms_center += center_error * center_error / truth.centers.size();
    errors.max_center = std::max(errors.max_center, center_error);
  }
  errors.rms_center = std::sqrt(errors.rms_center);
  for (size_t p = 0; p < truth.points.size(); ++p) {
    errors.max_point =
        std::max(errors.max_point, error(scene.points[p], truth.points[p]));
  }
  return errors;
}

TEST(GlobalPositioning, RecoversExactSceneWithoutNoise) {
  const Scene truth = CreateScene({});
  Scene scene = Perturb(truth, 0.5, 0.3);
  const GlobalPositioningSummary summary = Solve(&scene, TightOptions());
  ASSERT_TRUE(summary.success) << summary.message;
  EXPECT_LT(summary.final_cost, 1e-18);
  const Errors errors = Compare(scene, truth);
  // Gauss-Newton on a zero-residual problem: rounding times the condition.
  EXPECT_LT(errors.max_center, 1e-8);
  EXPECT_LT(errors.max_point, 1e-8);
}

TEST(GlobalPositioning, ManyCamerasTakeTheSparseSolver) {
  SceneOptions options;
  options.num_cameras = 80;
  options.num_points = 800;
  options.track_length = 10;
  const Scene truth = CreateScene(options);
  Scene scene = Perturb(truth, 0.1, 0.1);
  ASSERT_TRUE(Solve(&scene, TightOptions()).success);
  // Larger condition than above: the ring closes through eight tracks.
  EXPECT_LT(Compare(scene, truth).max_center, 1e-7);
}

TEST(GlobalPositioning, HardStartConverges) {
  const Scene truth = CreateScene({});
  // Centres off by 30 %, points by 20 % of the ring's diameter.
  Scene scene = Perturb(truth, 3 / std::sqrt(3.), 2 / std::sqrt(3.));
  ASSERT_TRUE(Solve(&scene, TightOptions()).success);
  EXPECT_LT(Compare(scene, truth).max_center, 1e-6);
}

TEST(GlobalPositioning, KeepsScaleOfTheStart) {
  for (const double scale : {0.01, 1.0, 70.0}) {
    const Scene truth = CreateScene({});
    Scene start = truth;
    for (Eigen::Vector3d& center : start.centers) center *= scale;
    for (Eigen::Vector3d& point : start.points) point *= scale;
    Scene scene = start;
    ASSERT_TRUE(Solve(&scene).success);
    for (size_t i = 0; i < scene.centers.size(); ++i) {
      // The start is the solution: rounding alone.
      EXPECT_LT((scene.centers[i] - start.centers[i]).norm(), 1e-12 * scale);
    }
  }
}

TEST(GlobalPositioning, NoisyStartKeepsItsMedianDistance) {
  const Scene truth = CreateScene({});
  const Scene start = Perturb(truth, 0.2, 0.2);
  Scene scene = start;
  ASSERT_TRUE(Solve(&scene).success);
  std::vector<double> log_ratios;
  for (const auto& observation : start.observations) {
    const auto distance = [&](const Scene& s) {
      return (s.points[observation.point] - s.centers[observation.camera])
          .norm();
    };
    log_ratios.push_back(std::log(distance(scene) / distance(start)));
  }
  // Rounding of the gauge that the solution is brought to.
  EXPECT_NEAR(Median(log_ratios), 0, 1e-12);
}

TEST(GlobalPositioning, MovesWithTheWorldFrame) {
  SceneOptions options;
  options.noise_deg = 0.2;
  options.outlier_ratio = 0.1;
  const Scene start = Perturb(CreateScene(options), 0.3, 0.3);
  const Eigen::Vector3d shift(4e5, 5e6, 100);
  const double scale = 1000;
  Scene scene = start;
  Scene moved = start;
  for (auto* vectors : {&moved.centers, &moved.points}) {
    for (Eigen::Vector3d& vector : *vectors) vector = scale * vector + shift;
  }
  ASSERT_TRUE(Solve(&scene).success);
  ASSERT_TRUE(Solve(&moved).success);
  for (size_t i = 0; i < scene.centers.size(); ++i) {
    // Coordinates of 5e6 carry 1e-9 of rounding into the start, 1e-12 in the
    // unit of the scene, and the iterations stop at the same step.
    EXPECT_LT(((moved.centers[i] - shift) / scale - scene.centers[i]).norm(),
              1e-8);
  }
}

TEST(GlobalPositioning, FixedCameraStaysBitwise) {
  const Scene start = Perturb(CreateScene({}), 0.3, 0.3);
  Scene scene = start;
  ASSERT_TRUE(SolveGlobalPositioning(
                  scene.observations, 3, {}, &scene.centers, &scene.points)
                  .success);
  EXPECT_EQ(scene.centers[3], start.centers[3]);
  EXPECT_NE(scene.centers[0], start.centers[0]);
}

TEST(GlobalPositioning, UnobservedCamerasAndPointsStayWhereTheyAre) {
  Scene scene = Perturb(CreateScene({}), 0.3, 0.3);
  const Eigen::Vector3d lost_center(9, 8, 7);
  const Eigen::Vector3d lost_point(-9, 8, 7);
  scene.centers.push_back(lost_center);
  scene.points.insert(scene.points.begin() + 5, lost_point);
  for (auto& observation : scene.observations) {
    if (observation.point >= 5) ++observation.point;
  }
  ASSERT_TRUE(Solve(&scene).success);
  EXPECT_EQ(scene.centers.back(), lost_center);
  EXPECT_EQ(scene.points[5], lost_point);
}

TEST(GlobalPositioning, HuberLossLimitsOutliers) {
  SceneOptions options;
  options.noise_deg = 0.1;
  options.outlier_ratio = 0.1;
  const Scene truth = CreateScene(options);
  Scene robust = Perturb(truth, 0.3, 0.3);
  Scene quadratic = robust;
  ASSERT_TRUE(Solve(&robust).success);
  GlobalPositioningOptions quadratic_options;
  quadratic_options.loss_scale = 1e3;
  ASSERT_TRUE(Solve(&quadratic, quadratic_options).success);
  const double robust_error = Compare(robust, truth).rms_center;
  // An outlier of 30 deg keeps a pull of 0.1; 0.5 without the loss.
  EXPECT_LT(robust_error, 0.2);
  EXPECT_LT(robust_error, 0.5 * Compare(quadratic, truth).rms_center);
}

TEST(GlobalPositioning, WeightsSuppressOutliers) {
  SceneOptions options;
  options.outlier_ratio = 0.1;
  options.outlier_weight = 1e-8;
  const Scene truth = CreateScene(options);
  Scene scene = Perturb(truth, 0.3, 0.3);
  ASSERT_TRUE(Solve(&scene, TightOptions()).success);
  // Pulls of 0.1 x 1e-8 per outlier, next to curvatures of 0.04 (distance 5)
  // per inlier and a condition of some hundreds.
  EXPECT_LT(Compare(scene, truth).max_center, 1e-5);
}

TEST(GlobalPositioning, PointsBehindTheirCamerasStayFinite) {
  const Scene truth = CreateScene({});
  Scene scene = Perturb(truth, 0.1, 0.1);
  // Mirrored at camera p, the first of the track, and one in its centre.
  for (const int p : {3, 50, 51}) {
    scene.points[p] = 2 * scene.centers[p % 12] - scene.points[p];
  }
  scene.points[7] = scene.centers[7];
  ASSERT_TRUE(Solve(&scene, TightOptions()).success);
  for (const Eigen::Vector3d& point : scene.points) {
    EXPECT_TRUE(point.allFinite());
  }
  // Lost points pull at nothing, all others still determine the cameras.
  EXPECT_LT(Compare(scene, truth).max_center, 1e-6);
}

TEST(GlobalPositioning, NonFiniteStartFailsAndChangesNothing) {
  const Scene start = Perturb(CreateScene({}), 0.3, 0.3);
  Scene scene = start;
  scene.points[4].y() = std::numeric_limits<double>::quiet_NaN();
  const GlobalPositioningSummary summary = Solve(&scene);
  EXPECT_FALSE(summary.success);
  EXPECT_EQ(summary.message, "start is not finite");
  EXPECT_EQ(scene.centers, start.centers);
  EXPECT_EQ(scene.points[5], start.points[5]);
}

TEST(GlobalPositioning, PointsInTheirCamerasGiveNoNan) {
  Scene scene = CreateScene({});
  for (Eigen::Vector3d& center : scene.centers) center.setOnes();
  for (Eigen::Vector3d& point : scene.points) point.setOnes();
  Solve(&scene);
  for (const Eigen::Vector3d& center : scene.centers) {
    EXPECT_TRUE(center.allFinite());
  }
}

TEST(GlobalPositioning, NothingObservedFails) {
  std::vector<Eigen::Vector3d> centers(2, Eigen::Vector3d::Zero());
  std::vector<Eigen::Vector3d> points;
  EXPECT_FALSE(SolveGlobalPositioning({}, 0, {}, &centers, &points).success);
}

TEST(GlobalPositioning, ThrowsOnBrokenInput) {
  const auto solve = [](const PositioningObservation& observation,
                        int fixed_camera,
                        const GlobalPositioningOptions& options) {
    std::vector<Eigen::Vector3d> centers(2, Eigen::Vector3d::Zero());
    std::vector<Eigen::Vector3d> points(3, Eigen::Vector3d::UnitZ());
    return SolveGlobalPositioning(
        {observation}, fixed_camera, options, &centers, &points);
  };
  const Eigen::Vector3d ray = Eigen::Vector3d::UnitZ();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(solve({1, 2, ray}, 0, {}).success);
  EXPECT_THROW(solve({2, 2, ray}, 0, {}), std::invalid_argument);
  EXPECT_THROW(solve({1, -1, ray}, 0, {}), std::invalid_argument);
  EXPECT_THROW(solve({1, 2, ray}, 2, {}), std::invalid_argument);
  EXPECT_THROW(solve({1, 2, 2 * ray}, 0, {}), std::invalid_argument);
  EXPECT_THROW(solve({1, 2, nan * ray}, 0, {}), std::invalid_argument);
  EXPECT_THROW(solve({1, 2, ray, 0}, 0, {}), std::invalid_argument);
  EXPECT_THROW(solve({1, 2, ray, nan}, 0, {}), std::invalid_argument);
  GlobalPositioningOptions options;
  options.num_threads = 0;
  EXPECT_THROW(solve({1, 2, ray}, 0, options), std::invalid_argument);
}

TEST(GlobalPositioning, SameBitsTwiceAndCloseWithTwoThreads) {
  SceneOptions scene_options;
  scene_options.noise_deg = 0.2;
  scene_options.outlier_ratio = 0.1;
  const Scene start = Perturb(CreateScene(scene_options), 0.3, 0.3);
  Scene scene1 = start;
  Scene scene2 = start;
  Scene scene3 = start;
  GlobalPositioningOptions options;
  ASSERT_TRUE(Solve(&scene1, options).success);
  ASSERT_TRUE(Solve(&scene2, options).success);
  options.num_threads = 2;
  ASSERT_TRUE(Solve(&scene3, options).success);
  EXPECT_EQ(scene1.centers, scene2.centers);
  EXPECT_EQ(scene1.points, scene2.points);
  for (size_t i = 0; i < start.centers.size(); ++i) {
    // Sums in another order, through some ten iterations.
    EXPECT_LT((scene1.centers[i] - scene3.centers[i]).norm(), 1e-9);
  }
}

TEST(GlobalPositioning, ReachesTheMinimumOfThePlainFormulation) {
  SceneOptions options;
  options.noise_deg = 0.5;
  options.outlier_ratio = 0.02;
  Scene scene = Perturb(CreateScene(options), 0.2, 0.2);
  for (size_t k = 0; k < scene.observations.size(); ++k) {
    scene.observations[k].weight = k % 2 == 0 ? 1 : 0.5;
  }
  Scene plain = scene;
  GlobalPositioningOptions plain_options = TightOptions();
  plain_options.max_num_iterations = 500;
  const PointMinimizerSummary expected = MinimizeWithScales(plain.observations,
                                                            /*fixed_camera=*/0,
                                                            plain_options,
                                                            &plain.centers,
                                                            &plain.points);
  const GlobalPositioningSummary summary = Solve(&scene, TightOptions());
  ASSERT_TRUE(expected.success && summary.success);
  // The scales start at their best.
  EXPECT_NEAR(summary.initial_cost,
              expected.initial_cost,
              1e-9 * expected.initial_cost);
  EXPECT_GT(summary.initial_cost, 2 * expected.final_cost);
  // Both have converged; outliers make the last steps small.
  EXPECT_NEAR(
      summary.final_cost, expected.final_cost, 1e-4 * expected.final_cost);
}

TEST(GlobalPositioning, BodiesKeepTheirShapeAndFixTheScale) {
  const Scene truth = CreateScene({});
  // Cameras i and i + 6 are on opposite sides of the ring.
  PositioningBodies bodies;
  for (int i = 0; i < 12; ++i) bodies.body_of_camera.push_back(i % 6);
  bodies.fix_scale = true;
  Scene scene = truth;
  std::mt19937 random(7);
  for (int i = 1; i < 6; ++i) {
    const Eigen::Vector3d shift = 0.3 * RandomVector(&random);
    scene.centers[i] += shift;
    scene.centers[i + 6] += shift;
  }
  for (Eigen::Vector3d& point : scene.points) {
    point = 1.2 * point + 0.1 * RandomVector(&random);
  }
  ASSERT_TRUE(SolveGlobalPositioning(scene.observations,
                                     0,
                                     TightOptions(),
                                     &scene.centers,
                                     &scene.points,
                                     bodies)
                  .success);
  for (int i = 0; i < 12; ++i) {
    // Exact rays: what is left is that of the solver's tolerance.
    EXPECT_LT((scene.centers[i] - truth.centers[i]).norm(), 1e-5) << i;
  }
}

}  // namespace
}  // namespace dgsfm
