#include "estimators/optimization/bundle_solver.h"

#include "estimators/optimization/camera_projection.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera_models.h>
#include <colmap/base/cost_functions.h>

#include <random>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr RobustLoss kLoss = {RobustLoss::Type::SOFT_L1, 0.5};

struct SceneOptions {
  bool share_camera = false;
  double noise_px = 0;
  int num_images = 8;
};

// Cameras on an arc see 60 points; the gauge is fixed as in the mapper.
Bundle TrueBundle(const SceneOptions& options) {
  Bundle bundle;
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> noise(0, options.noise_px);
  for (int i = 0; i < options.num_images; ++i) {
    if (i == 0 || !options.share_camera) {
      bundle.cameras.push_back({2, {500.0 + 10 * i, 320, 240, 0.05}, {0, 3}});
    }
    BundleImage image;
    image.camera = int(bundle.cameras.size()) - 1;
    image.cam_from_world.rotation = Eigen::AngleAxisd(
        0.1 * (i - 4), Eigen::Vector3d(0.2 * uniform(rng), 1, 0).normalized());
    image.cam_from_world.translation << 0.1 * uniform(rng), 0.1 * uniform(rng),
        5 + 0.5 * uniform(rng);
    bundle.images.push_back(image);
  }
  bundle.images.front().is_constant.fill(true);
  bundle.images.back().is_constant[5] = true;
  for (int i = 0; i < 60; ++i) {
    bundle.points.emplace_back(uniform(rng), uniform(rng), uniform(rng));
    for (int j = 0; j < options.num_images; ++j) {
      if ((i + j) % 3 == 0) continue;
      const BundleImage& image = bundle.images[j];
      Eigen::Vector2d xy_px;
      ProjectionOfModel(2)(bundle.cameras[image.camera].params.data(),
                           image.cam_from_world * bundle.points.back(),
                           &xy_px,
                           nullptr);
      xy_px += Eigen::Vector2d(noise(rng), noise(rng));
      bundle.observations.push_back({j, i, xy_px});
    }
  }
  return bundle;
}

Bundle Disturbed(Bundle bundle) {
  std::mt19937 rng(8);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (BundleCamera& camera : bundle.cameras) camera.params[0] *= 1.03;
  for (size_t i = 1; i < bundle.images.size(); ++i) {
    Rigid3d& pose = bundle.images[i].cam_from_world;
    pose.rotation = pose.rotation * Eigen::AngleAxisd(0.02 * uniform(rng),
                                                      Eigen::Vector3d::UnitX());
    pose.translation.head<2>() +=
        0.05 * Eigen::Vector2d(uniform(rng), uniform(rng));
  }
  for (Eigen::Vector3d& point : bundle.points) {
    point += 0.05 * Eigen::Vector3d(uniform(rng), uniform(rng), uniform(rng));
  }
  return bundle;
}

PointMinimizerOptions Converging(int num_threads = 1) {
  PointMinimizerOptions options;
  options.function_tolerance = 1e-12;
  options.num_threads = num_threads;
  return options;
}

double MaxPointError(const Bundle& a, const Bundle& b) {
  double error = 0;
  for (size_t i = 0; i < a.points.size(); ++i) {
    error = std::max(error, (a.points[i] - b.points[i]).norm());
  }
  return error;
}

// The same cost by COLMAP's cost functions and Ceres.
double CeresCost(const RobustLoss& loss, Bundle bundle) {
  ceres::Problem problem;
  std::vector<Eigen::Vector4d> qvecs;
  for (BundleImage& image : bundle.images) {
    qvecs.push_back(QvecFromRotation(image.cam_from_world.rotation));
  }
  for (const BundleObservation& observation : bundle.observations) {
    BundleImage& image = bundle.images[observation.image];
    problem.AddResidualBlock(
        colmap::BundleAdjustmentCostFunction<
            colmap::SimpleRadialCameraModel>::Create(observation.xy_px),
        loss.type == RobustLoss::Type::CAUCHY
            ? static_cast<ceres::LossFunction*>(
                  new ceres::CauchyLoss(loss.scale))
            : new ceres::SoftLOneLoss(loss.scale),
        qvecs[observation.image].data(),
        image.cam_from_world.translation.data(),
        bundle.points[observation.point].data(),
        bundle.cameras[image.camera].params.data());
  }
  for (size_t i = 0; i < bundle.images.size(); ++i) {
    problem.SetManifold(qvecs[i].data(), new ceres::QuaternionManifold());
  }
  problem.SetParameterBlockConstant(qvecs[0].data());
  problem.SetParameterBlockConstant(
      bundle.images[0].cam_from_world.translation.data());
  problem.SetManifold(bundle.images.back().cam_from_world.translation.data(),
                      new ceres::SubsetManifold(3, {2}));
  for (BundleCamera& camera : bundle.cameras) {
    problem.SetManifold(camera.params.data(),
                        new ceres::SubsetManifold(4, {1, 2}));
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.function_tolerance = 1e-12;
  options.max_num_iterations = 500;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.final_cost;
}

TEST(BundleSolver, ExactObservationsGiveTheTruth) {
  for (const bool share_camera : {false, true}) {
    const Bundle truth = TrueBundle({share_camera, 0});
    Bundle bundle = Disturbed(truth);
    const PointMinimizerSummary summary =
        SolveBundle(Converging(), kLoss, &bundle);
    EXPECT_TRUE(summary.success);
    // Converged to rounding, quadratically.
    EXPECT_LT(summary.final_cost, 1e-12);
    EXPECT_LT(MaxPointError(bundle, truth), 1e-6);
    EXPECT_NEAR(bundle.cameras[0].params[0], 500, 1e-4);
    EXPECT_EQ(bundle.cameras[0].params[1], 320);
  }
}

TEST(BundleSolver, ReachesTheMinimumThatCeresReaches) {
  using Type = RobustLoss::Type;
  for (const Type type : {Type::SOFT_L1, Type::CAUCHY}) {
    for (const bool share_camera : {false, true}) {
      const RobustLoss loss = {type, type == Type::SOFT_L1 ? 0.5 : 2.0};
      Bundle bundle = Disturbed(TrueBundle({share_camera, 1.0}));
      const double expected = CeresCost(loss, bundle);
      const PointMinimizerSummary summary =
          SolveBundle(Converging(), loss, &bundle);
      EXPECT_GT(summary.initial_cost, 2 * expected);
      // Both stop within their tolerance per iteration of a slow descent.
      EXPECT_NEAR(summary.final_cost, expected, 1e-6 * expected);
    }
  }
}

TEST(BundleSolver, WrongPointsDoNotHoldUpTheCameras) {
  Bundle bundle = TrueBundle({/*share_camera=*/true, /*noise_px=*/0.5});
  std::mt19937 rng(3);
  std::normal_distribution<double> noise(0, 8);
  for (int i = 0; i < 20; ++i) {
    bundle.points.emplace_back(0.1 * i, 0, -50);
    for (const int j : {3, 4}) {
      const BundleImage& image = bundle.images[j];
      Eigen::Vector2d xy_px;
      ProjectionOfModel(2)(
          bundle.cameras[image.camera].params.data(),
          image.cam_from_world * Eigen::Vector3d(0.1 * i, 0, 5),
          &xy_px,
          nullptr);
      xy_px += Eigen::Vector2d(noise(rng), noise(rng));
      bundle.observations.push_back({j, int(bundle.points.size()) - 1, xy_px});
    }
  }
  const PointMinimizerSummary summary = SolveBundle({}, kLoss, &bundle);
  EXPECT_TRUE(summary.converged);
  // 20 until the points have converged, too.
  EXPECT_LT(summary.num_iterations, 17);
}

// 120 cameras along a street, each point seen by six neighbours.
Bundle Street() {
  Bundle bundle;
  std::mt19937 rng(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> noise(0, 0.5);
  bundle.cameras.push_back({2, {500, 320, 240, 0}, {}});
  for (int i = 0; i < 120; ++i) {
    BundleImage image;
    image.cam_from_world.translation << -0.5 * i, 0.1 * uniform(rng), 5;
    bundle.images.push_back(image);
  }
  bundle.images[0].is_constant.fill(true);
  bundle.images.back().is_constant[3] = true;
  for (int i = 0; i < 15 * 115; ++i) {
    const int first = i % 115;
    bundle.points.emplace_back(
        0.5 * first + 1 + uniform(rng), uniform(rng), uniform(rng));
    for (int j = first; j < first + 6; ++j) {
      const Eigen::Vector3d in_cam =
          bundle.images[j].cam_from_world * bundle.points.back();
      bundle.observations.push_back(
          {j,
           i,
           500 * in_cam.hnormalized() +
               Eigen::Vector2d(320 + noise(rng), 240 + noise(rng))});
    }
  }
  return Disturbed(bundle);
}

TEST(BundleSolver, ConjugateGradientsReachTheSameMinimum) {
  Bundle direct = Street();
  Bundle iterative = direct;
  PointMinimizerOptions options = Converging();
  const double expected = SolveBundle(options, kLoss, &direct).final_cost;
  options.max_num_factor_entries = 1000;
  const PointMinimizerSummary summary = SolveBundle(options, kLoss, &iterative);
  EXPECT_TRUE(summary.converged);
  // Steps that are not quite those of the equations slow convergence down.
  EXPECT_NEAR(summary.final_cost, expected, 1e-6 * expected);
  // They are other steps.
  EXPECT_GT(MaxPointError(direct, iterative), 0);
  EXPECT_LT(MaxPointError(direct, iterative), 1e-2);
}

TEST(BundleSolver, ConjugateGradientsReachTheSameMinimumOfSharedIntrinsics) {
  for (const int num_images : {8, 9}) {
    Bundle direct = Disturbed(TrueBundle({true, 0.5, num_images}));
    Bundle iterative = direct;
    PointMinimizerOptions options = Converging();
    const PointMinimizerSummary expected = SolveBundle(options, kLoss, &direct);
    options.max_num_factor_entries = 1;
    const PointMinimizerSummary summary =
        SolveBundle(options, kLoss, &iterative);
    EXPECT_TRUE(summary.converged);
    // Both end at a relative decrease of 1e-12.
    EXPECT_NEAR(
        summary.final_cost, expected.final_cost, 1e-9 * expected.final_cost);
    // Steps that solve their equations to 1e-4 are about as good.
    EXPECT_LE(summary.num_iterations, expected.num_iterations + 3);
  }
}

TEST(BundleSolver, LongChainIsFactorisedAfterConjugateGradientsTakeTooLong) {
  Bundle direct = Street();
  Bundle both = direct;
  PointMinimizerOptions options = Converging();
  SolveBundle(options, kLoss, &direct);
  options.max_num_factor_operations = 0;
  SolveBundle(options, kLoss, &both);
  EXPECT_EQ(MaxPointError(direct, both), 0);
}

TEST(BundleSolver, ConstantParametersStay) {
  Bundle bundle = Disturbed(TrueBundle({}));
  const Bundle start = bundle;
  SolveBundle(Converging(), kLoss, &bundle);
  EXPECT_EQ(bundle.images[0].cam_from_world.rotation.coeffs(),
            start.images[0].cam_from_world.rotation.coeffs());
  EXPECT_EQ(bundle.images[0].cam_from_world.translation,
            start.images[0].cam_from_world.translation);
  EXPECT_EQ(bundle.images.back().cam_from_world.translation.z(),
            start.images.back().cam_from_world.translation.z());
}

TEST(BundleSolver, DoesNotDependOnThreads) {
  // By a factor, and by conjugate gradients.
  for (const double max_num_factor_entries : {1e8, 1.0}) {
    Bundle one = Disturbed(TrueBundle({true, 1.0}));
    Bundle three = one;
    PointMinimizerOptions options = Converging(1);
    options.max_num_factor_entries = max_num_factor_entries;
    SolveBundle(options, kLoss, &one);
    options.num_threads = 3;
    SolveBundle(options, kLoss, &three);
    EXPECT_EQ(MaxPointError(one, three), 0);
  }
}

TEST(BundleSolver, StrongPriorHoldsTheFocalLength) {
  Bundle bundle = Disturbed(TrueBundle({true, 0.5}));
  bundle.priors = {{0, {{0, 507, 1e-6}}}};
  SolveBundle(Converging(), kLoss, &bundle);
  EXPECT_NEAR(bundle.cameras[0].params[0], 507, 1e-3);
}

TEST(BundleSolver, TracksMayMeetAnImageTwice) {
  Bundle once = Disturbed(TrueBundle({false, 1.0}));
  Bundle twice = once;
  // Two equal observations weigh as much as their point seen by two images.
  for (size_t k = 0; k < once.observations.size(); k += 5) {
    twice.observations.push_back(once.observations[k]);
  }
  const double expected = CeresCost(kLoss, twice);
  const PointMinimizerSummary summary =
      SolveBundle(Converging(), kLoss, &twice);
  EXPECT_NEAR(summary.final_cost, expected, 1e-6 * expected);
}

TEST(BundleSolver, PointInThePlaneOfACenterFails) {
  Bundle bundle = TrueBundle({});
  const Rigid3d& pose = bundle.images[0].cam_from_world;
  bundle.points[1] = pose.TargetOriginInSource();
  const Bundle start = bundle;
  EXPECT_FALSE(SolveBundle(Converging(), kLoss, &bundle).success);
  EXPECT_EQ(MaxPointError(bundle, start), 0);
}

TEST(BundleSolver, IndexOutOfRangeThrows) {
  Bundle bundle = TrueBundle({});
  bundle.observations[0].point = 60;
  EXPECT_THROW(SolveBundle(Converging(), kLoss, &bundle),
               std::invalid_argument);
}

// The true bundle with images 2 i and 2 i + 1 as frame i of two sensors.
Bundle TrueRigBundle() {
  SceneOptions options;
  options.share_camera = true;
  Bundle bundle = TrueBundle(options);
  bundle.sensors.resize(2);
  bundle.sensors[1].cam_from_rig = {
      Eigen::Quaterniond(Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY())),
      Eigen::Vector3d(-0.3, 0.05, 0.1)};
  for (int i = 0; i < 4; ++i) {
    bundle.frames.push_back({bundle.images[2 * i].cam_from_world, {}});
    for (int j = 0; j < 2; ++j) {
      BundleImage& image = bundle.images[2 * i + j];
      image.frame = i;
      image.sensor = j;
      image.is_constant = {};
      image.cam_from_world =
          bundle.sensors[j].cam_from_rig * bundle.frames[i].rig_from_world;
    }
  }
  bundle.frames[0].is_constant.fill(true);
  for (BundleObservation& observation : bundle.observations) {
    const BundleImage& image = bundle.images[observation.image];
    ProjectionOfModel(2)(
        bundle.cameras[image.camera].params.data(),
        image.cam_from_world * bundle.points[observation.point],
        &observation.xy_px,
        nullptr);
  }
  return bundle;
}

Bundle DisturbedFrames(Bundle bundle) {
  for (size_t i = 1; i < bundle.frames.size(); ++i) {
    bundle.frames[i].rig_from_world.translation.x() += 0.03 * double(i);
  }
  for (size_t i = 0; i < bundle.points.size(); ++i) {
    bundle.points[i].z() += i % 2 == 0 ? 0.04 : -0.04;
  }
  return bundle;
}

TEST(SolveBundle, FramesKeepTheirShapeAndFixTheScale) {
  const Bundle truth = TrueRigBundle();
  Bundle bundle = DisturbedFrames(truth);
  ASSERT_TRUE(SolveBundle(Converging(), kLoss, &bundle).success);
  // Exact data: what is left is that of the solver's tolerance.
  EXPECT_LT(MaxPointError(bundle, truth), 1e-5);
  for (size_t i = 0; i < bundle.images.size(); ++i) {
    const BundleImage& image = bundle.images[i];
    const Rigid3d expected = bundle.sensors[image.sensor].cam_from_rig *
                             bundle.frames[image.frame].rig_from_world;
    EXPECT_EQ(image.cam_from_world.translation, expected.translation);
  }
}

// A strip of images that see points before them, bent by an angle.
Bundle BentStrip(int num_images, double angle_rad) {
  Bundle bundle;
  bundle.cameras.push_back({2, {500, 320, 240, 0}, {}});
  const auto bent = [&](double x) {
    const double angle = angle_rad * x / num_images;
    const double radius = num_images / angle_rad;
    return Rigid3d(
        Eigen::Quaterniond(Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY())),
        radius * Eigen::Vector3d(std::sin(angle), 0, 1 - std::cos(angle)));
  };
  for (int i = 0; i < num_images; ++i) {
    bundle.images.emplace_back().cam_from_world = bent(i).Inverse();
  }
  for (int i = 0; i < num_images; ++i) {
    for (int row = 0; row < 6; ++row) {
      const Eigen::Vector3d offset(
          0.1 * row, -1.5 + 0.6 * row, 4 + (i + row) % 3);
      for (int j = std::max(0, i - 2); j < std::min(num_images, i + 3); ++j) {
        const Eigen::Vector3d in_cam = offset + Eigen::Vector3d(i - j, 0, 0);
        bundle.observations.push_back(
            {j,
             int(bundle.points.size()),
             500 * in_cam.hnormalized() + Eigen::Vector2d(320, 240)});
      }
      bundle.points.push_back(bent(i) * offset);
    }
  }
  bundle.images.front().is_constant.fill(true);
  bundle.images.back().is_constant[3] = true;
  bundle.curved_steps = true;
  return bundle;
}

TEST(SolveBundle, CurvedStepsFindTheSameMinimum) {
  for (const bool has_rig : {false, true}) {
    Bundle straight = has_rig ? DisturbedFrames(TrueRigBundle())
                              : Disturbed(TrueBundle({false, 0.5}));
    Bundle curved = straight;
    curved.curved_steps = true;
    const PointMinimizerSummary expected =
        SolveBundle(Converging(), kLoss, &straight);
    const PointMinimizerSummary summary =
        SolveBundle(Converging(), kLoss, &curved);
    // Exact observations of the rig leave rounding only.
    EXPECT_NEAR(summary.final_cost,
                expected.final_cost,
                1e-9 * expected.final_cost + 1e-9);
    EXPECT_LT(MaxPointError(curved, straight), 1e-4);
    // What fixes the gauge stays.
    EXPECT_EQ(curved.images[0].cam_from_world.translation,
              straight.images[0].cam_from_world.translation);
    if (has_rig) continue;
    EXPECT_EQ(curved.images.back().cam_from_world.translation.z(),
              straight.images.back().cam_from_world.translation.z());
  }
}

TEST(SolveBundle, BentStripUnbendsInFewSteps) {
  Bundle bundle = BentStrip(200, 30 * M_PI / 180);
  PointMinimizerOptions options = Converging();
  options.initial_damping = 1e-9;
  options.min_damping_ratio = 0.1;
  options.function_tolerance = 1e-4;
  // Steps along straight lines are rejected, and take 100 and more.
  options.max_num_iterations = 10;
  const PointMinimizerSummary summary = SolveBundle(options, kLoss, &bundle);
  EXPECT_TRUE(summary.success);
  EXPECT_LT(summary.final_cost, 1e-6 * summary.initial_cost);
  for (int i = 0; i < 200; ++i) {
    const Rigid3d& pose = bundle.images[i].cam_from_world;
    EXPECT_LT(pose.rotation.angularDistance(Eigen::Quaterniond::Identity()),
              1e-4);
  }
}

TEST(SolveBundle, DampingHoldsTheFirstStepBack) {
  std::vector<double> costs;
  for (const double damping : {1.0, 1e-9}) {
    Bundle bundle = Disturbed(TrueBundle({false, 0.5}));
    PointMinimizerOptions options = Converging();
    options.max_num_iterations = 1;
    options.initial_damping = damping;
    costs.push_back(SolveBundle(options, kLoss, &bundle).final_cost);
  }
  EXPECT_LT(costs[1], costs[0]);
}

TEST(SolveBundle, RefinesSensors) {
  const Bundle truth = TrueRigBundle();
  Bundle bundle = DisturbedFrames(truth);
  bundle.sensors[1].is_refined = true;
  bundle.sensors[1].cam_from_rig.translation.y() += 0.05;
  bundle.sensors[1].cam_from_rig.rotation =
      bundle.sensors[1].cam_from_rig.rotation *
      Eigen::Quaterniond(Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitX()));
  // Without a known baseline the scale is free.
  bundle.frames.back().rig_from_world = truth.frames.back().rig_from_world;
  bundle.frames.back().is_constant[5] = true;
  ASSERT_TRUE(SolveBundle(Converging(), kLoss, &bundle).success);
  EXPECT_LT(MaxPointError(bundle, truth), 1e-5);
  EXPECT_LT((bundle.sensors[1].cam_from_rig.translation -
             truth.sensors[1].cam_from_rig.translation)
                .norm(),
            1e-5);
  EXPECT_LT(bundle.sensors[1].cam_from_rig.rotation.angularDistance(
                truth.sensors[1].cam_from_rig.rotation),
            1e-5);
}

// Priors at the true centres, that count little beside key points.
void AddTruePriors(const Bundle& truth, Bundle* bundle) {
  for (const BundleImage& image : truth.images) {
    CenterPrior& prior = bundle->center_priors.emplace_back();
    prior.center = image.cam_from_world.TargetOriginInSource();
    prior.sqrt_information = Eigen::Vector3d(2, 3, 1).asDiagonal();
  }
  bundle->center_prior_weight.weight = 1;
}

TEST(SolveBundle, CentersHoldImagesInTheirFrame) {
  const Bundle truth = TrueBundle({});
  Bundle bundle = Disturbed(truth);
  for (BundleImage& image : bundle.images) image.is_constant = {};
  AddTruePriors(truth, &bundle);
  ASSERT_TRUE(SolveBundle(Converging(), kLoss, &bundle).success);
  EXPECT_LT(MaxPointError(bundle, truth), 1e-4);
}

// The centres are those of the images, which frame and sensor move.
TEST(SolveBundle, CentersHoldFramesAndSensors) {
  const Bundle truth = TrueRigBundle();
  for (const bool refine_sensor : {false, true}) {
    Bundle bundle = DisturbedFrames(truth);
    bundle.frames[0].is_constant = {};
    bundle.sensors[1].is_refined = refine_sensor;
    if (refine_sensor) bundle.sensors[1].cam_from_rig.translation.y() += 0.05;
    AddTruePriors(truth, &bundle);
    ASSERT_TRUE(SolveBundle(Converging(), kLoss, &bundle).success);
    EXPECT_LT(MaxPointError(bundle, truth), 1e-4) << refine_sensor;
  }
}

}  // namespace
}  // namespace dgsfm
