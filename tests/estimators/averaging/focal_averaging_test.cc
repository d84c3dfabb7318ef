#include "estimators/averaging/focal_averaging.h"

#include "estimators/averaging/kruppa_cost.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Logarithms and back: a few roundings.
constexpr double kRelativeRounding = 1e-14;

TEST(AverageFocals, NothingFromNoEstimates) {
  EXPECT_FALSE(AverageFocals({}).has_value());
}

TEST(AverageFocals, SingleEstimateHasNoSpread) {
  const auto focal = AverageFocals({700});
  EXPECT_NEAR(focal->focal_length_px, 700, 700 * kRelativeRounding);
  EXPECT_EQ(focal->log_spread, 0);
}

TEST(AverageFocals, OddCountGivesTheMiddle) {
  const auto focal = AverageFocals({1e6, 500, 1000});
  EXPECT_NEAR(focal->focal_length_px, 1000, 1000 * kRelativeRounding);
  EXPECT_NEAR(focal->log_spread, 1.4826 * std::log(2), 1e-12);
}

TEST(AverageFocals, EvenCountGivesTheGeometricMean) {
  EXPECT_NEAR(AverageFocals({1600, 1, 400, 1e5})->focal_length_px,
              800,
              800 * kRelativeRounding);
}

TEST(AverageFocals, SpreadIsTheStandardDeviationOfNormalNoise) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::vector<double> estimates;
  for (int i = 0; i < 10000; ++i) {
    estimates.push_back(1000 * std::exp(0.1 * normal(random)));
  }
  const auto focal = AverageFocals(estimates);
  // Standard errors of median and MAD of 10000 values: 1.3 % and 1.2 % of
  // the deviation; three of them.
  EXPECT_NEAR(std::log(focal->focal_length_px / 1000), 0, 0.004);
  EXPECT_NEAR(focal->log_spread, 0.1, 0.004);
}

TEST(AverageFocals, ThrowsOnBrokenEstimates) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double focal : {0.0, -1.0, nan, 1 / 0.0}) {
    EXPECT_THROW(AverageFocals({1000, focal}), std::invalid_argument);
  }
}

struct CameraRing {
  std::vector<double> focal_lengths_px;
  std::vector<PairFundamental> pairs;
};

Eigen::Vector3d RandomVector(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return {normal(*random), normal(*random), normal(*random)};
}

// Ten cameras on an arc around a scene, each paired with its four successors;
// optical axes pass the centre at random distances. F carries relative noise
// in its entries as an essential matrix.
CameraRing CreateRing(double noise, double outlier_ratio) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::bernoulli_distribution is_outlier(outlier_ratio);
  CameraRing ring;
  std::vector<Eigen::Matrix3d> cam_from_world;
  std::vector<Eigen::Vector3d> centers;
  for (int i = 0; i < 10; ++i) {
    ring.focal_lengths_px.push_back(1000 * std::exp(0.3 * normal(random)));
    const double angle = M_PI * i / 10;
    centers.emplace_back(
        5 * std::cos(angle), 5 * std::sin(angle), normal(random));
    const Eigen::Vector3d z =
        (0.8 * RandomVector(&random) - centers.back()).normalized();
    const Eigen::Vector3d x = z.cross(RandomVector(&random)).normalized();
    Eigen::Matrix3d world_from_cam;
    world_from_cam << x, z.cross(x), z;
    cam_from_world.push_back(world_from_cam.transpose());
  }
  for (int i = 0; i < 10; ++i) {
    for (int j = i + 1; j < std::min(i + 5, 10); ++j) {
      const Eigen::Matrix3d R =
          cam_from_world[j] * cam_from_world[i].transpose();
      const Eigen::Vector3d t =
          (cam_from_world[j] * (centers[i] - centers[j])).normalized();
      Eigen::Matrix3d E;
      for (int c = 0; c < 3; ++c) E.col(c) = t.cross(R.col(c));
      for (double& entry : E.reshaped()) entry += noise * normal(random);
      if (is_outlier(random)) {
        for (double& entry : E.reshaped()) entry = normal(random);
      }
      const double f1 = ring.focal_lengths_px[i];
      const double f2 = ring.focal_lengths_px[j];
      const Eigen::Matrix3d F =
          Eigen::Vector3d(1 / f2, 1 / f2, 1).asDiagonal() * E *
          Eigen::Vector3d(1 / f1, 1 / f1, 1).asDiagonal();
      ring.pairs.push_back({i, j, F / F.norm()});
    }
  }
  return ring;
}

double MaxLogError(const std::vector<double>& focals1,
                   const std::vector<double>& focals2) {
  double error = 0;
  for (size_t i = 0; i < focals1.size(); ++i) {
    error = std::max(error, std::abs(std::log(focals1[i] / focals2[i])));
  }
  return error;
}

TEST(KruppaCost, VanishesAtTheTruthInAnyUnit) {
  const CameraRing ring = CreateRing(0, 0);
  for (const PairFundamental& pair : ring.pairs) {
    for (const double unit : {1.0, 800.0}) {
      const double log_focal1 =
          std::log(ring.focal_lengths_px[pair.camera1] / unit);
      const double log_focal2 =
          std::log(ring.focal_lengths_px[pair.camera2] / unit);
      Eigen::Vector3d residual;
      KruppaCostFunctor(pair.F, unit, unit)(
          &log_focal1, &log_focal2, residual.data());
      // Rounding, enlarged by up to f^2 for unit 1.
      EXPECT_LT(residual.norm(), unit > 1 ? 1e-12 : 1e-8);
    }
  }
}

// Exact pairs leave nothing to the prior.
ViewGraphCalibrationOptions WithoutPrior() {
  ViewGraphCalibrationOptions options;
  options.start_log_stddev = 1e6;
  return options;
}

TEST(CalibrateViewGraph, RecoversExactFocalsFromFarStart) {
  const CameraRing ring = CreateRing(0, 0);
  for (const double start : {500.0, 1000.0, 2000.0}) {
    std::vector<double> focals(10, start);
    const std::vector<char> estimated = CalibrateViewGraph(
        ring.pairs, std::vector<char>(10, 0), WithoutPrior(), &focals);
    EXPECT_EQ(estimated, std::vector<char>(10, 1));
    // Zero residual at the solution: Gauss-Newton ends in rounding.
    EXPECT_LT(MaxLogError(focals, ring.focal_lengths_px), 1e-8);
  }
}

TEST(CalibrateViewGraph, KnownCamerasStayAndAreNoEstimates) {
  const CameraRing ring = CreateRing(0, 0);
  std::vector<double> focals(10, 1000);
  std::vector<char> known(10, 0);
  for (const int i : {2, 6}) {
    known[i] = 1;
    focals[i] = ring.focal_lengths_px[i];
  }
  const auto estimated =
      CalibrateViewGraph(ring.pairs, known, WithoutPrior(), &focals);
  for (int i = 0; i < 10; ++i) EXPECT_NE(estimated[i], known[i]);
  EXPECT_EQ(focals[2], ring.focal_lengths_px[2]);
  EXPECT_LT(MaxLogError(focals, ring.focal_lengths_px), 1e-8);
}

TEST(CalibrateViewGraph, NoiseGivesProportionalErrors) {
  const CameraRing ring = CreateRing(1e-3, 0);
  std::vector<double> focals(10, 1000);
  CalibrateViewGraph(ring.pairs, std::vector<char>(10, 0), {}, &focals);
  // Focal lengths are some ten times weaker than F itself.
  EXPECT_LT(MaxLogError(focals, ring.focal_lengths_px), 2e-2);
}

TEST(CalibrateViewGraph, CauchyLossResistsWrongPairs) {
  const CameraRing ring = CreateRing(0, 0.2);
  std::vector<double> focals(10, 1000);
  CalibrateViewGraph(ring.pairs, std::vector<char>(10, 0), {}, &focals);
  // A residual of 0.5 keeps a weight of 4e-4 at the loss scale of 0.01.
  EXPECT_LT(MaxLogError(focals, ring.focal_lengths_px), 1e-2);
}

TEST(CalibrateViewGraph, PairOfOneCameraGivesItsFocal) {
  const CameraRing ring = CreateRing(0, 0);
  // The first pair as if of one camera: undo the second focal length.
  PairFundamental pair = ring.pairs[0];
  const double focal = ring.focal_lengths_px[0];
  const double ratio = ring.focal_lengths_px[1] / focal;
  pair.F = Eigen::Vector3d(ratio, ratio, 1).asDiagonal() * pair.F;
  pair.camera2 = 0;
  std::vector<double> focals = {800};
  EXPECT_EQ(CalibrateViewGraph({pair}, {0}, WithoutPrior(), &focals)[0], 1);
  EXPECT_NEAR(focals[0], focal, 1e-6 * focal);
}

// Pairs of a camera that moves along its axis without turning fit any focal
// length: the epipole lies in the principal point.
TEST(CalibrateViewGraph, StaysAtTheStartWherePairsTellNothing) {
  PairFundamental pair;
  pair.camera2 = 1;
  pair.F << 0, -1, 0, 1, 0, 0, 0, 0, 0;
  std::mt19937 random(1);
  std::normal_distribution<double> normal(0, 1e-6);
  std::vector<PairFundamental> pairs(20, pair);
  for (PairFundamental& noisy : pairs) {
    for (double& entry : noisy.F.reshaped()) entry += normal(random);
  }
  std::vector<double> focals = {800, 800};
  CalibrateViewGraph(pairs, {0, 0}, {}, &focals);
  // One standard deviation of the prior.
  EXPECT_LT(std::abs(std::log(focals[0] / 800)), 0.5);
  EXPECT_LT(std::abs(std::log(focals[1] / 800)), 0.5);
}

TEST(CalibrateViewGraph, EstimatesBeyondTheRatioReturnToTheStart) {
  const CameraRing ring = CreateRing(0, 0);
  std::vector<double> focals(10, 1000);
  focals[4] = ring.focal_lengths_px[4] / 2.5;
  ViewGraphCalibrationOptions options;
  options.min_focal_ratio = 0.4;
  options.max_focal_ratio = 2.2;
  const auto estimated = CalibrateViewGraph(
      ring.pairs, std::vector<char>(10, 0), options, &focals);
  EXPECT_EQ(estimated[4], 0);
  EXPECT_EQ(focals[4], ring.focal_lengths_px[4] / 2.5);
}

TEST(CalibrateViewGraph, CamerasWithoutPairsAreNotEstimated) {
  const CameraRing ring = CreateRing(0, 0);
  std::vector<double> focals(11, 1000);
  const auto estimated =
      CalibrateViewGraph(ring.pairs, std::vector<char>(11, 0), {}, &focals);
  EXPECT_EQ(estimated[10], 0);
  EXPECT_EQ(focals[10], 1000);
  focals.resize(2);
  EXPECT_EQ(CalibrateViewGraph({}, {0, 1}, {}, &focals),
            std::vector<char>(2, 0));
  EXPECT_EQ(CalibrateViewGraph({ring.pairs[0]}, {1, 1}, {}, &focals),
            std::vector<char>(2, 0));
}

TEST(CalibrateViewGraph, ThrowsOnBrokenInput) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const PairFundamental good = CreateRing(0, 0).pairs[0];
  const auto calibrate = [](const PairFundamental& pair,
                            std::vector<double> focals,
                            const ViewGraphCalibrationOptions& options) {
    return CalibrateViewGraph({pair}, {0, 0}, options, &focals);
  };
  EXPECT_EQ(calibrate(good, {1000, 1000}, {}).size(), 2);
  EXPECT_THROW(calibrate(good, {1000}, {}), std::invalid_argument);
  EXPECT_THROW(calibrate(good, {1000, nan}, {}), std::invalid_argument);
  EXPECT_THROW(calibrate(good, {0, 1000}, {}), std::invalid_argument);
  EXPECT_THROW(calibrate({0, 2, good.F}, {1000, 1000}, {}),
               std::invalid_argument);
  EXPECT_THROW(calibrate({0, 1, 0 * good.F}, {1000, 1000}, {}),
               std::invalid_argument);
  EXPECT_THROW(calibrate({0, 1, nan * good.F}, {1000, 1000}, {}),
               std::invalid_argument);
  ViewGraphCalibrationOptions options;
  options.max_focal_ratio = 1;
  EXPECT_THROW(calibrate(good, {1000, 1000}, options), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
