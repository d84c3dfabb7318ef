#include "sfm/verification/pair_verification.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/verification/pair_fingerprint.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

colmap::Camera CreateCamera(const std::string& model,
                            int width,
                            int height,
                            const std::vector<double>& params,
                            bool is_known = true) {
  colmap::Camera camera;
  camera.SetModelIdFromName(model);
  camera.SetWidth(width);
  camera.SetHeight(height);
  camera.SetParams(params);
  camera.SetPriorFocalLength(is_known);
  return camera;
}

colmap::Camera Pinhole(bool is_known, double focal_length_px = 700) {
  return CreateCamera(
      "SIMPLE_PINHOLE", 1000, 800, {focal_length_px, 500, 400}, is_known);
}

// Images 1 and 2 of cameras 1 and 2, each with key points i of true match i.
struct TestPair {
  Scene scene;
  KeypointDepthMap depths;
  colmap::FeatureMatches matches;
  std::vector<bool> is_inlier;
  Rigid3d cam2_from_cam1;
  double scale_1_from_2 = 2.5;
};

struct TestPairOptions {
  int num_matches = 400;
  double outlier_ratio = 0.3;
  double noise_px = 0.3;
  // Largest angle between rays and optical axis [deg].
  double max_angle_deg = 80;
};

// The cameras see as they are; in the scene, those without a prior focal
// length have the guess of COLMAP.
TestPair CreatePair(const colmap::Camera& camera1,
                    const colmap::Camera& camera2,
                    const TestPairOptions& options = {}) {
  std::mt19937_64 random(3);
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(random);
  };
  std::normal_distribution<double> normal;
  const auto random_pixel = [&](const colmap::Camera& camera) {
    const double x = uniform(0, double(camera.Width()));
    return Eigen::Vector2d(x, uniform(0, double(camera.Height())));
  };
  // False where the camera does not see the point.
  const auto project = [&](const colmap::Camera& camera,
                           const Eigen::Vector3d& point,
                           Eigen::Vector2d* xy) {
    if (point.z() < std::cos(options.max_angle_deg * M_PI / 180) * point.norm())
      return false;
    *xy = camera.WorldToImage(point.hnormalized());
    return xy->x() >= 0 && xy->y() >= 0 && xy->x() <= camera.Width() &&
           xy->y() <= camera.Height();
  };
  TestPair pair;
  pair.cam2_from_cam1 = {Eigen::Quaterniond(Eigen::AngleAxisd(
                             0.2, Eigen::Vector3d(0.3, 1, 0.2).normalized())),
                         Eigen::Vector3d(0.8, 0.1, 0.2)};
  std::vector<Eigen::Vector2d> xys1, xys2;
  std::vector<float> depths1, depths2;
  while (int(xys1.size()) < options.num_matches) {
    const Eigen::Vector3d point =
        uniform(2, 8) * Eigen::Vector3d(normal(random),
                                        normal(random),
                                        std::abs(normal(random)))
                            .normalized();
    const Eigen::Vector3d point2 = pair.cam2_from_cam1 * point;
    Eigen::Vector2d xy1, xy2;
    if (!project(camera1, point, &xy1) || !project(camera2, point2, &xy2)) {
      continue;
    }
    pair.is_inlier.push_back(uniform(0, 1) >= options.outlier_ratio);
    if (!pair.is_inlier.back()) xy2 = random_pixel(camera2);
    const auto noise = [&] {
      const double x = options.noise_px * normal(random);
      return Eigen::Vector2d(x, options.noise_px * normal(random));
    };
    pair.matches.emplace_back(xys1.size(), xys1.size());
    xys1.push_back(xy1 + noise());
    xys2.push_back(xy2 + noise());
    depths1.push_back(float(point.z()));
    depths2.push_back(float(point2.z() / pair.scale_1_from_2));
  }
  const auto add = [&](colmap::image_t id,
                       colmap::Camera camera,
                       const std::vector<Eigen::Vector2d>& xys,
                       const std::vector<float>& depths) {
    camera.SetCameraId(id);
    if (!camera.HasPriorFocalLength()) {
      for (const size_t idx : camera.FocalLengthIdxs()) {
        camera.Params(idx) =
            1.2 * double(std::max(camera.Width(), camera.Height()));
      }
    }
    pair.scene.cameras.emplace(id, camera);
    colmap::Image image;
    image.SetImageId(id);
    image.SetCameraId(id);
    image.SetPoints2D(xys);
    pair.scene.images.emplace(id, image);
    pair.depths[id] = {DepthUnit::METRIC, depths};
  };
  add(1, camera1, xys1, depths1);
  add(2, camera2, xys2, depths2);
  return pair;
}

PairGeometry Verify(const TestPair& pair) {
  return VerifyPair(
      pair.scene, pair.depths, PairIdOfImages(1, 2), pair.matches, {});
}

void ExpectPose(const TestPair& pair,
                const PairGeometry& geometry,
                double max_error_deg) {
  ASSERT_EQ(geometry.status, PairStatus::VALID);
  const Rigid3d& truth = pair.cam2_from_cam1;
  EXPECT_LT(truth.rotation.angularDistance(geometry.cam2_from_cam1.rotation),
            max_error_deg * M_PI / 180);
  ASSERT_TRUE(geometry.has_scale);
  EXPECT_LT((geometry.cam2_from_cam1.translation - truth.translation).norm(),
            max_error_deg * M_PI / 180 * 10);
  EXPECT_NEAR(geometry.scale_1_from_2 / pair.scale_1_from_2, 1, 0.02);
}

// Share of the right matches among the inliers.
double Recall(const TestPair& pair, const PairGeometry& geometry) {
  int num_found = 0;
  for (const colmap::FeatureMatch& match : geometry.inlier_matches) {
    num_found += pair.is_inlier[match.point2D_idx1];
  }
  return double(num_found) /
         double(std::count(pair.is_inlier.begin(), pair.is_inlier.end(), true));
}

void ExpectSame(const PairGeometry& a, const PairGeometry& b) {
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.cam2_from_cam1.translation, b.cam2_from_cam1.translation);
  EXPECT_EQ(a.cam2_from_cam1.rotation.coeffs(),
            b.cam2_from_cam1.rotation.coeffs());
  EXPECT_EQ(a.scale_1_from_2, b.scale_1_from_2);
  EXPECT_EQ(a.focal_length1_px, b.focal_length1_px);
  EXPECT_EQ(a.focal_length2_px, b.focal_length2_px);
  EXPECT_EQ(a.degeneracies, b.degeneracies);
  EXPECT_EQ(a.log_scale_stddev, b.log_scale_stddev);
  EXPECT_EQ(a.depth_verified, b.depth_verified);
  ASSERT_EQ(a.inlier_matches.size(), b.inlier_matches.size());
  for (size_t i = 0; i < a.inlier_matches.size(); ++i) {
    EXPECT_EQ(a.inlier_matches[i].point2D_idx1,
              b.inlier_matches[i].point2D_idx1);
  }
}

TEST(VerifyPairs, ResultDependsOnNeitherThreadsNorOrder) {
  SyntheticSceneOptions options;
  options.num_images = 12;
  options.image_noise_px = 0.5;
  options.outlier_match_ratio = 0.4;
  options.known_focal_length = false;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Scene scene = SceneFromSynthetic(synthetic);
  const KeypointDepthMap depths = KeypointDepthsFromSynthetic(synthetic);
  PairVerificationOptions verification;
  verification.num_threads = 1;
  const PairGeometries one = VerifyPairs(scene, depths, verification);
  verification.num_threads = 2;
  const PairGeometries two = VerifyPairs(scene, depths, verification);
  ASSERT_EQ(one.size(), scene.matches.size());
  ASSERT_EQ(two.size(), scene.matches.size());
  std::vector<colmap::image_pair_t> pair_ids;
  for (const auto& [pair_id, pair] : one) {
    ExpectSame(pair, two.at(pair_id));
    pair_ids.push_back(pair_id);
  }
  std::shuffle(pair_ids.begin(), pair_ids.end(), std::mt19937(5));
  for (const colmap::image_pair_t pair_id : pair_ids) {
    ExpectSame(
        VerifyPair(
            scene, depths, pair_id, scene.matches.at(pair_id), verification),
        one.at(pair_id));
  }
}

TEST(VerifyPair, HoldsThresholdsInPixelsOfDistortedImages) {
  // Noise of 0.3 px leaves 99.9 % within the threshold of 1 px, of the image:
  // at 75 degrees a fisheye pixel is fifteen of the undistorted image. Its
  // angle is 0.02 to 0.04 degrees, before the matches average it.
  const auto fisheye = CreateCamera(
      "OPENCV_FISHEYE", 1000, 1000, {400, 410, 505, 490, 0.02, -0.01, 2e-3, 0});
  const auto radial =
      CreateCamera("RADIAL", 1000, 800, {700, 490, 410, -0.25, 0.06});
  const auto full = CreateCamera(
      "FULL_OPENCV",
      1000,
      800,
      {700, 720, 500, 400, -0.2, 0.05, 1e-3, -2e-3, 0.01, 0.02, -0.01, 0});
  for (const auto& [camera1, camera2] :
       {std::make_pair(fisheye, fisheye), {radial, radial}, {full, fisheye}}) {
    const TestPair pair = CreatePair(camera1, camera2);
    const PairGeometry geometry = Verify(pair);
    ExpectPose(pair, geometry, 0.1);
    EXPECT_GT(Recall(pair, geometry), 0.98) << camera1.ModelName();
    EXPECT_EQ(geometry.focal_length1_px, camera1.MeanFocalLength());
    EXPECT_FALSE(geometry.estimated_focal1 || geometry.estimated_focal2);
  }
}

TEST(VerifyPair, LeavesOutMatchesWithoutRay) {
  // Key points in the corners lie at 101 degrees.
  const auto fisheye = CreateCamera(
      "OPENCV_FISHEYE", 1000, 1000, {400, 400, 500, 500, 0, 0, 0, 0});
  TestPair pair = CreatePair(fisheye, fisheye);
  colmap::Image& image = pair.scene.images.at(1);
  std::vector<Eigen::Vector2d> xys;
  for (const colmap::Point2D& point : image.Points2D()) {
    xys.push_back(point.XY());
  }
  for (size_t i = 0; i < 40; ++i) xys[i] = Eigen::Vector2d(1, 1);
  colmap::Image changed;
  changed.SetImageId(1);
  changed.SetCameraId(1);
  changed.SetPoints2D(xys);
  image = changed;
  const PairGeometry geometry = Verify(pair);
  ExpectPose(pair, geometry, 0.1);
  EXPECT_EQ(geometry.num_matches, pair.matches.size());
  for (const colmap::FeatureMatch& match : geometry.inlier_matches) {
    EXPECT_GE(match.point2D_idx1, 40);
  }
}

TEST(VerifyPair, EstimatesTheFocalLengthsThatAreNotKnown) {
  // 1 % is three times the error that noise of 0.3 px leaves with exact depths.
  // Known ones are rounded, since points are divided by them.
  constexpr double kRounding = 1e-12;
  for (const bool known1 : {false, true}) {
    for (const bool known2 : {false, true}) {
      const TestPair pair = CreatePair(Pinhole(known1), Pinhole(known2, 800));
      const PairGeometry geometry = Verify(pair);
      ASSERT_EQ(geometry.status, PairStatus::VALID);
      EXPECT_EQ(geometry.estimated_focal1, !known1);
      EXPECT_EQ(geometry.estimated_focal2, !known2);
      EXPECT_NEAR(geometry.focal_length1_px, 700, known1 ? kRounding : 7);
      EXPECT_NEAR(geometry.focal_length2_px, 800, known2 ? kRounding : 8);
    }
  }
  TestPair shared = CreatePair(Pinhole(false), Pinhole(false));
  shared.scene.images.at(2).SetCameraId(1);
  const PairGeometry geometry = Verify(shared);
  EXPECT_EQ(geometry.focal_length1_px, geometry.focal_length2_px);
  EXPECT_NEAR(geometry.focal_length1_px, 700, 7);
}

TEST(VerifyPair, KeepsPairsWhoseMapsHaveDifferentUnits) {
  TestPair pair = CreatePair(Pinhole(true), Pinhole(true));
  // Metres and millimetres.
  for (float& depth : pair.depths.at(2).depths) depth *= 1000;
  pair.scale_1_from_2 /= 1000;
  ExpectPose(pair, Verify(pair), 0.1);
}

TEST(VerifyPair, TakesOutPairsWhoseMatchesDoNotMove) {
  TestPairOptions options;
  options.noise_px = 0;
  TestPair pair = CreatePair(Pinhole(true), Pinhole(true), options);
  // A watermark: the same pixels in both images.
  colmap::Image watermark = pair.scene.images.at(1);
  watermark.SetImageId(2);
  watermark.SetCameraId(2);
  pair.scene.images.at(2) = watermark;
  const PairGeometry geometry = Verify(pair);
  EXPECT_EQ(geometry.status, PairStatus::STATIONARY);
  EXPECT_TRUE(geometry.Has(PairDegeneracy::STATIONARY));
}

TEST(PairFingerprint, ChangesWithAllThatThePairIsVerifiedFrom) {
  const TestPair pair = CreatePair(Pinhole(true), Pinhole(false));
  const auto fingerprint = [&](const TestPair& p, const std::string& text) {
    return PairFingerprint(CreatePairImage(p.scene, p.depths, 1),
                           CreatePairImage(p.scene, p.depths, 2),
                           p.matches,
                           text);
  };
  std::vector<uint64_t> values = {fingerprint(pair, "a=1"),
                                  fingerprint(pair, "a=2")};
  EXPECT_EQ(fingerprint(pair, "a=1"), values[0]);
  TestPair changed = pair;
  changed.matches.pop_back();
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  std::swap(changed.matches[0], changed.matches[1]);
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  changed.depths.at(2).depths[7] *= 2;
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  changed.depths.at(2).focal_length_px = 700;
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  changed.depths.erase(1);
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  changed.scene.cameras.at(1).Params(0) += 1;
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  changed.scene.cameras.at(2).SetPriorFocalLength(true);
  values.push_back(fingerprint(changed, "a=1"));
  changed = pair;
  changed.scene.images.at(2).SetCameraId(1);
  values.push_back(fingerprint(changed, "a=1"));
  std::sort(values.begin(), values.end());
  EXPECT_EQ(std::unique(values.begin(), values.end()), values.end());
}

}  // namespace
}  // namespace dgsfm
