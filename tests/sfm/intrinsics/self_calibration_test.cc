#include "sfm/intrinsics/self_calibration.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/intrinsics/intrinsics_evidence.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr double kKeypointStddev = 0.5;

// One camera entry for each image, true poses and points, noisy key points.
SyntheticScene CreateScene(int num_distinct_cameras,
                           double crop_ratio = 0,
                           std::optional<double> distortion = {}) {
  SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::RING);
  options.num_images = 12;
  options.num_points_per_image = 300;
  options.image_noise_px = kKeypointStddev;
  options.known_focal_length = false;
  options.camera.num_cameras = 0;
  options.camera.num_distinct_cameras = num_distinct_cameras;
  options.camera.max_log_focal_offset = 0.3;
  options.camera.max_distortion_offset = distortion ? 0 : 0.05;
  options.camera.radial_distortion = distortion.value_or(0);
  options.camera.crop_ratio = crop_ratio;
  return SynthesizeScene(options);
}

SelfCalibrationOptions CalibrationOptions(
    const BundleAdjustmentOptions& adjustment) {
  SelfCalibrationOptions options;
  options.bundle_adjustment = adjustment;
  options.adjust = [adjustment](const CameraBeliefs& beliefs,
                                int max_num_iterations,
                                colmap::Reconstruction* model) {
    BundleAdjustmentOptions limited = adjustment;
    limited.max_num_iterations = max_num_iterations;
    return AdjustBundle(limited, 1, 1, beliefs, model).has_value();
  };
  return options;
}

class AdjustedScene {
 public:
  explicit AdjustedScene(int num_distinct_cameras,
                         double crop_ratio = 0,
                         std::optional<double> distortion = {})
      : synthetic_(CreateScene(num_distinct_cameras, crop_ratio, distortion)),
        model_(ReconstructionFromSynthetic(synthetic_)) {
    beliefs_.given = SceneFromSynthetic(synthetic_).cameras;
    for (const auto& [camera_id, camera] : beliefs_.given) {
      model_.Camera(camera_id).SetPriorFocalLength(false);
    }
    options_.intrinsics.refine_principal_point = true;
  }

  bool Adjust(const std::vector<CameraGroup>& groups = {}) {
    beliefs_.groups = groups;
    return AdjustBundle(options_, 1, 1, beliefs_, &model_).has_value();
  }

  // Images that contradict one set of intrinsics for all.
  std::vector<colmap::image_t> Contradicting() {
    const SelfCalibrationOptions options = CalibrationOptions(options_);
    CameraBeliefs beliefs = beliefs_;
    TieCameraClasses(options_.intrinsics, &beliefs, &model_);
    for (const auto& [camera_id, camera] : model_.Cameras()) {
      beliefs.held_principal_points.insert(camera_id);
    }
    EXPECT_TRUE(options.adjust(beliefs, 100, &model_));
    return FindContradictingImages(options, beliefs, model_);
  }

  std::vector<CameraGroup> Classes() const {
    return FindCameraClasses(options_.intrinsics, beliefs_, model_);
  }

  CameraBeliefs Calibrate() {
    return CalibrateModel(CalibrationOptions(options_), beliefs_, &model_);
  }

  std::optional<IntrinsicsPosterior> Posterior(int num_threads = 1) const {
    return EstimateIntrinsicsPosterior(options_, num_threads, beliefs_, model_);
  }

  const CameraBeliefs& Beliefs() const { return beliefs_; }

  const colmap::Reconstruction& Model() const { return model_; }

  const colmap::Camera& TrueCamera(colmap::camera_t camera_id) const {
    return synthetic_.cameras.at(camera_id);
  }

  double MaxFocalError() const {
    double max_error = 0;
    for (const auto& [camera_id, camera] : model_.Cameras()) {
      max_error =
          std::max(max_error,
                   std::abs(camera.MeanFocalLength() /
                                TrueCamera(camera_id).MeanFocalLength() -
                            1));
    }
    return max_error;
  }

 private:
  SyntheticScene synthetic_;
  CameraBeliefs beliefs_;
  colmap::Reconstruction model_;
  BundleAdjustmentOptions options_;
};

TEST(EstimateIntrinsicsPosterior, CoversTheErrors) {
  AdjustedScene scene(1);
  ASSERT_TRUE(scene.Adjust());
  const auto posterior = scene.Posterior();
  ASSERT_TRUE(posterior);
  double sum = 0;
  const auto size = posterior->params.size();
  for (const auto& [camera_id, first_param] : posterior->first_params) {
    for (Eigen::Index i = 0; i < 4; ++i) {
      const double error = posterior->params(first_param + i) -
                           scene.TrueCamera(camera_id).Params(size_t(i));
      sum += error * error /
             posterior->covariance(first_param + i, first_param + i);
    }
  }
  // Errors of all cameras have parts in common: a mean of squares of 1, as far
  // as few independent values tell.
  EXPECT_GT(sum / double(size), 0.2);
  EXPECT_LT(sum / double(size), 4);
}

TEST(EstimateIntrinsicsPosterior, IsTheSameForAnyNumberOfThreads) {
  AdjustedScene scene(1);
  ASSERT_TRUE(scene.Adjust());
  const auto expected = scene.Posterior();
  ASSERT_TRUE(expected);
  for (const int num_threads : {2, 5}) {
    const auto posterior = scene.Posterior(num_threads);
    ASSERT_TRUE(posterior);
    EXPECT_EQ(posterior->params, expected->params);
    EXPECT_EQ(posterior->covariance, expected->covariance);
    EXPECT_EQ(posterior->keypoint_covariance, expected->keypoint_covariance);
  }
}

TEST(AdjustBundle, GroupsShareTheirIntrinsicsAndGainAccuracy) {
  AdjustedScene scene(1);
  ASSERT_TRUE(scene.Adjust());
  const double untied_error = scene.MaxFocalError();
  ASSERT_TRUE(scene.Adjust(scene.Classes()));
  for (const auto& [camera_id, camera] : scene.Model().Cameras()) {
    EXPECT_EQ(camera.Params(), scene.Model().Camera(1).Params());
  }
  EXPECT_LT(scene.MaxFocalError(), untied_error);
  const auto posterior = scene.Posterior();
  ASSERT_TRUE(posterior);
  ASSERT_EQ(posterior->first_params.size(), 1);
  EXPECT_EQ(posterior->first_params.count(1), 1);
}

// Whatever the origin of the world is: the coordinate that is held must be one
// that tells the scale.
TEST(AdjustBundle, KeepsTheScale) {
  const AdjustedScene scene(1);
  for (const double offset : {0.0, 10.0, 30.0}) {
    for (const int coordinate : {0, 1, 2}) {
      const Eigen::Vector3d shift = offset * Eigen::Vector3d::Unit(coordinate);
      colmap::Reconstruction model = scene.Model();
      for (const colmap::image_t image_id : model.RegImageIds()) {
        Rigid3d pose = CamFromWorld(model.Image(image_id));
        pose.translation +=
            Eigen::Vector3d(0.05, -0.05, 0.05) * (image_id % 2 == 0 ? 1 : -1) -
            pose.rotation * shift;
        SetCamFromWorld(pose, &model.Image(image_id));
      }
      for (const colmap::point3D_t point_id : model.Point3DIds()) {
        colmap::Point3D& point = model.Point3D(point_id);
        point.SetXYZ(point.XYZ() + shift);
      }
      const auto diameter = [&model] {
        double distance = 0;
        for (const colmap::image_t image_id : model.RegImageIds()) {
          distance = std::max(
              distance,
              (CamFromWorld(model.Image(image_id)).TargetOriginInSource() -
               CamFromWorld(model.Image(1)).TargetOriginInSource())
                  .norm());
        }
        return distance;
      };
      const double start_diameter = diameter();
      const BundleAdjustmentOptions options;
      ASSERT_TRUE(AdjustBundle(options, 1, 1, scene.Beliefs(), &model));
      // The start is off by a hundredth of the diameter.
      EXPECT_NEAR(diameter() / start_diameter, 1, 0.03);
    }
  }
}

TEST(AdjustBundle, KnownCamerasStayWithinTheirPrior) {
  SyntheticScene synthetic = CreateScene(1);
  synthetic.options.known_focal_length = true;
  const CameraBeliefs beliefs = {
      SceneFromSynthetic(synthetic).cameras, {}, {}, {}, {}, {}};
  colmap::Reconstruction model = ReconstructionFromSynthetic(synthetic);
  BundleAdjustmentOptions options;
  options.intrinsics.refine_principal_point = true;
  ASSERT_TRUE(AdjustBundle(options, 1, 1, beliefs, &model));
  for (const auto& [camera_id, camera] : model.Cameras()) {
    const colmap::Camera& prior = beliefs.given.at(camera_id);
    EXPECT_NEAR(camera.MeanFocalLength() / prior.MeanFocalLength(),
                1,
                options.intrinsics.focal_length_stddev_ratio);
    EXPECT_EQ(camera.PrincipalPointX(), prior.PrincipalPointX());
    EXPECT_NEAR(camera.Params(3),
                prior.Params(3),
                options.intrinsics.extra_params_stddev);
  }
}

TEST(AdjustBundle, HeldCamerasStayAsTheyAre) {
  AdjustedScene scene(1);
  CameraBeliefs beliefs = scene.Beliefs();
  beliefs.held_cameras = {1, 2};
  colmap::Reconstruction model = scene.Model();
  BundleAdjustmentOptions options;
  options.intrinsics.refine_principal_point = true;
  ASSERT_TRUE(AdjustBundle(options, 1, 1, beliefs, &model));
  for (colmap::camera_t id = 1; id <= 12; ++id) {
    const bool is_same =
        model.Camera(id).Params() == scene.Model().Camera(id).Params();
    EXPECT_EQ(is_same, id <= 2) << id;
  }
}

// Focal lengths by EXIF data of crops are wrong: what the images determine
// counts for more.
TEST(AdjustBundle, SoftFocalPriorsGiveWayToTheImages) {
  AdjustedScene scene(1);
  CameraBeliefs beliefs = scene.Beliefs();
  for (const auto& [camera_id, camera] : beliefs.given) {
    beliefs.focal_priors[camera_id] = {
        1.15 * scene.TrueCamera(camera_id).MeanFocalLength(), 0.05};
  }
  colmap::Reconstruction model = scene.Model();
  BundleAdjustmentOptions options;
  ASSERT_TRUE(AdjustBundle(options, 1, 1, beliefs, &model));
  for (const auto& [camera_id, camera] : model.Cameras()) {
    // Rings tell focal lengths of single images to one or two per cent.
    EXPECT_NEAR(camera.MeanFocalLength() /
                    scene.TrueCamera(camera_id).MeanFocalLength(),
                1,
                0.03);
  }
}

TEST(FindCameraClasses, KeepCamerasApartThatExifDoes) {
  AdjustedScene scene(1);
  CameraBeliefs beliefs = scene.Beliefs();
  const IntrinsicsPriorOptions prior;
  EXPECT_EQ(FindCameraClasses(prior, beliefs, scene.Model()).size(), 1);
  const std::vector<colmap::camera_t> first_half = {1, 2, 3, 4, 5, 6};
  for (colmap::camera_t id = 1; id <= 12; ++id) {
    beliefs.labels[id] = id <= 6 ? "a|b||35 mm" : "a|b||50 mm";
  }
  auto groups = FindCameraClasses(prior, beliefs, scene.Model());
  ASSERT_EQ(groups.size(), 2);
  EXPECT_EQ(groups[0].camera_ids, first_half);

  // Zooms by the focal lengths in the database, which rounding may change.
  beliefs.labels.clear();
  for (colmap::camera_t id = 1; id <= 12; ++id) {
    beliefs.focal_priors[id] = {(id <= 6 ? 700 : 720) + 1e-4 * id, 0.05};
  }
  groups = FindCameraClasses(prior, beliefs, scene.Model());
  ASSERT_EQ(groups.size(), 2);
  EXPECT_EQ(groups[0].camera_ids, first_half);

  // Small steps do not make one kind of many zooms.
  for (colmap::camera_t id = 1; id <= 12; ++id) {
    beliefs.focal_priors[id] = {700 * std::pow(1.0015, id), 0.05};
  }
  EXPECT_EQ(FindCameraClasses(prior, beliefs, scene.Model()).size(), 6);
}

TEST(FindContradictingImages, OnlyWhereFocalLengthsDiffer) {
  EXPECT_TRUE(AdjustedScene(1).Contradicting().empty());
  EXPECT_EQ(AdjustedScene(0).Contradicting().size(), 12);
  // Half of the images of another camera: neither half is right.
  EXPECT_EQ(AdjustedScene(2).Contradicting().size(), 12);
}

// An arc of a few degrees around an object leaves the principal point open; a
// collection from all sides determines it.
TEST(FindHeldPrincipalPoints, FreesWhatIsDeterminedAndDeviates) {
  for (const SceneFamily family : {SceneFamily::RING, SceneFamily::INTERNET}) {
    // 2 px, 2.2 standard deviations, are more likely from the prior by a hair.
    for (const double offset_px : {0.0, 2.0, 12.0}) {
      SyntheticSceneOptions options = SceneFamilyOptions(family);
      options.num_images = family == SceneFamily::RING ? 8 : 12;
      options.num_points_per_image = 300;
      options.image_noise_px = kKeypointStddev;
      options.known_focal_length = false;
      options.camera = {};
      options.camera.num_cameras = 1;
      const SyntheticScene synthetic = SynthesizeScene(options);
      const colmap::Reconstruction model =
          ReconstructionFromSynthetic(synthetic);
      CameraBeliefs beliefs;
      beliefs.given = SceneFromSynthetic(synthetic).cameras;
      beliefs.given.at(1).SetPrincipalPointX(
          beliefs.given.at(1).PrincipalPointX() + offset_px);
      BundleAdjustmentOptions adjustment;
      adjustment.intrinsics.refine_principal_point = true;
      const auto posterior =
          EstimateIntrinsicsPosterior(adjustment, 1, beliefs, model);
      ASSERT_TRUE(posterior);
      const bool is_held =
          !FindHeldPrincipalPoints(
               adjustment.intrinsics, beliefs, *posterior, model)
               .empty();
      EXPECT_EQ(is_held, family == SceneFamily::RING || offset_px < 12)
          << SceneFamilyName(family) << " " << offset_px << " "
          << posterior->covariance.diagonal().cwiseSqrt().transpose();
    }
  }
}

// Smooth errors of whole images do not average out.
TEST(EstimateIntrinsicsPosterior, HasAFloorThatMorePointsDoNotLower) {
  std::vector<Eigen::Vector2d> keypoint_stddevs, stddevs;
  for (const int num_points : {300, 2700}) {
    SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::FACADE);
    options.num_images = 12;
    options.num_points_per_image = num_points;
    options.image_noise_px = kKeypointStddev;
    options.known_focal_length = false;
    options.camera.num_cameras = 1;
    const SyntheticScene synthetic = SynthesizeScene(options);
    CameraBeliefs beliefs;
    beliefs.given = SceneFromSynthetic(synthetic).cameras;
    BundleAdjustmentOptions adjustment;
    adjustment.intrinsics.refine_principal_point = true;
    const auto posterior = EstimateIntrinsicsPosterior(
        adjustment, 1, beliefs, ReconstructionFromSynthetic(synthetic));
    ASSERT_TRUE(posterior);
    stddevs.push_back(
        posterior->covariance.diagonal().segment<2>(1).cwiseSqrt());
    keypoint_stddevs.push_back(
        posterior->keypoint_covariance.diagonal().segment<2>(1).cwiseSqrt());
  }
  // A ninth of the variance, within what other points make of it.
  EXPECT_LT(keypoint_stddevs[1].norm(), 0.5 * keypoint_stddevs[0].norm());
  EXPECT_GT(stddevs[1].norm(), 0.7 * stddevs[0].norm());
}

TEST(FindCameraClasses, KnownCamerasAreTiedOnlyIfGivenTheSame) {
  AdjustedScene scene(1);
  for (const bool are_given_the_same : {true, false}) {
    CameraBeliefs beliefs = scene.Beliefs();
    for (auto& [camera_id, camera] : beliefs.given) {
      camera.SetPriorFocalLength(true);
      camera.SetParams(beliefs.given.at(1).Params());
      // Less than the standard deviation of the prior, 1 %.
      if (!are_given_the_same) {
        camera.SetFocalLength(camera.FocalLength() * (1 + 1e-4 * camera_id));
      }
    }
    beliefs.groups = FindCameraClasses({}, beliefs, scene.Model());
    EXPECT_EQ(beliefs.NumTiedCameras(), are_given_the_same ? 12 : 0);
  }
}

// Images without a position at first are resected later: castle-P19 lost 19
// points of AUC@1 by one that kept a camera of its own.
TEST(FindCameraClasses, HaveCamerasOfImagesThatAreNotRegistered) {
  const AdjustedScene scene(1);
  colmap::Reconstruction model = scene.Model();
  model.DeRegisterImage(model.RegImageIds().front());
  const auto groups = FindCameraClasses({}, scene.Beliefs(), model);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].camera_ids.size(), 12);
}

TEST(RenameCameras, MergesCamerasOfGroupsOnly) {
  AdjustedScene scene(2);
  colmap::Reconstruction model = scene.Model();
  RenameCameras(FirstOfGroups({{{1, 3, 5}}}), &model);
  EXPECT_EQ(model.NumCameras(), 10);
  EXPECT_EQ(model.Image(5).CameraId(), 1);
  EXPECT_EQ(model.Image(4).CameraId(), 4);
  EXPECT_EQ(model.NumRegImages(), scene.Model().NumRegImages());
  EXPECT_EQ(model.NumPoints3D(), scene.Model().NumPoints3D());
  EXPECT_EQ(model.ComputeNumObservations(),
            scene.Model().ComputeNumObservations());
}

// Images with a camera each, all of one image size but the first two.
colmap::Reconstruction ManyCameras(int num_images, CameraBeliefs* beliefs) {
  colmap::Reconstruction model;
  for (int i = 1; i <= num_images; ++i) {
    colmap::Camera camera;
    camera.SetCameraId(i);
    camera.InitializeWithName(
        "SIMPLE_RADIAL", 500, /*width=*/i <= 2 ? 640 : 800, 600);
    model.AddCamera(camera);
    beliefs->given[i] = camera;
    colmap::Image image;
    image.SetImageId(i);
    image.SetCameraId(i);
    image.SetName(std::to_string(i));
    model.AddImage(image);
    model.RegisterImage(i);
  }
  return model;
}

TEST(TieCameraClasses, LeavesGroupsThatAreNotJudgedUntied) {
  for (const int num_images : {100, 1000}) {
    CameraBeliefs beliefs;
    colmap::Reconstruction model = ManyCameras(num_images, &beliefs);
    TieCameraClasses({}, &beliefs, &model);
    // The posterior rests on 200 images, among 1,000 hardly on both that have
    // the first size.
    EXPECT_EQ(beliefs.groups.size(), num_images == 100 ? 2 : 1);
    EXPECT_EQ(beliefs.GroupOf(1) != nullptr, num_images == 100);
    EXPECT_NE(beliefs.GroupOf(3), nullptr);
  }
}

TEST(FindDeviatingImages, LargeDifferencesUntieTheOtherImagesToo) {
  CameraBeliefs beliefs;
  colmap::Reconstruction model = ManyCameras(6, &beliefs);
  TieCameraClasses({}, &beliefs, &model);
  for (const bool differ : {false, true}) {
    IntrinsicsPosterior by_image;
    // Images 3 and 4 were looked at, 5 and 6 have the same size.
    by_image.first_params = {{3, 0}, {4, 4}};
    by_image.params = Eigen::VectorXd::Zero(8);
    by_image.params(0) = 500;
    by_image.params(4) = differ ? 600 : 501;
    by_image.covariance = Eigen::MatrixXd::Identity(8, 8);
    EXPECT_EQ(FindDeviatingImages(beliefs, by_image, model),
              differ ? std::vector<colmap::image_t>({3, 4, 5, 6})
                     : std::vector<colmap::image_t>());
  }
}

TEST(CalibrateModel, HoldsPrincipalPointsUnlessTheImagesAreCrops) {
  // Were all of them crops, a common shift would hardly be observable.
  for (const double crop_ratio : {0.0, 0.5}) {
    AdjustedScene scene(0, crop_ratio);
    ASSERT_TRUE(scene.Adjust());
    const CameraBeliefs beliefs = scene.Calibrate();
    EXPECT_TRUE(beliefs.groups.empty());
    for (colmap::camera_t id = 1; id <= 12; ++id) {
      const colmap::Camera& truth = scene.TrueCamera(id);
      const double offset_px = std::hypot(truth.PrincipalPointX() - 400,
                                          truth.PrincipalPointY() - 300);
      const bool is_held = beliefs.held_principal_points.count(id) > 0;
      // Two standard deviations of the prior are 16 px, known to some px.
      if (offset_px < 10) {
        EXPECT_TRUE(is_held) << id;
      }
      if (offset_px > 25) {
        EXPECT_FALSE(is_held) << id;
      }
    }
  }
}

TEST(FindHeldDistortions, AreThoseOfUndistortedPhotosOfOneCamera) {
  for (const double distortion : {0.0, 0.05}) {
    for (const bool is_tied : {true, false}) {
      AdjustedScene scene(1, 0, distortion);
      ASSERT_TRUE(
          scene.Adjust(is_tied ? scene.Classes() : std::vector<CameraGroup>()));
      const auto posterior = scene.Posterior();
      ASSERT_TRUE(posterior);
      // Cameras of single images stay free.
      EXPECT_EQ(
          FindHeldDistortions({}, scene.Beliefs(), *posterior, scene.Model())
              .size(),
          is_tied && distortion == 0 ? 12 : 0);
    }
  }
}

TEST(AdjustBundle, LeavesHeldDistortionsAsTheyAre) {
  const SyntheticScene synthetic = CreateScene(1);
  CameraBeliefs beliefs;
  beliefs.given = SceneFromSynthetic(synthetic).cameras;
  beliefs.held_distortions = {1};
  colmap::Reconstruction model = ReconstructionFromSynthetic(synthetic);
  const double held = model.Camera(1).Params(3);
  const double free = model.Camera(2).Params(3);
  ASSERT_TRUE(AdjustBundle({}, 1, 1, beliefs, &model));
  EXPECT_EQ(model.Camera(1).Params(3), held);
  EXPECT_NE(model.Camera(2).Params(3), free);
}

TEST(CalibrateModel, FindsThePrincipalPointOfAGroup) {
  for (const double crop_ratio : {0.0, 1.0}) {
    AdjustedScene scene(1, crop_ratio);
    ASSERT_TRUE(scene.Adjust(scene.Classes()));
    const CameraBeliefs beliefs = scene.Calibrate();
    ASSERT_EQ(beliefs.groups.size(), 1);
    EXPECT_EQ(beliefs.groups[0].camera_ids.size(), 12);
    EXPECT_EQ(beliefs.held_principal_points.size(), crop_ratio == 0 ? 12 : 0);
    const colmap::Camera& camera = scene.Model().Camera(1);
    const colmap::Camera& truth = scene.TrueCamera(1);
    // The standard deviation of the prior.
    EXPECT_NEAR(camera.PrincipalPointX(), truth.PrincipalPointX(), 8);
    EXPECT_NEAR(camera.PrincipalPointY(), truth.PrincipalPointY(), 8);
  }
}

TEST(AdjustBundle, CropsFindTheirPrincipalPoints) {
  // Half of the images, off by up to 20 %: 20 standard deviations of the prior.
  // Were all of them crops, a common shift would hardly be observable. The
  // start is the truth: what counts is that the prior does not draw them away.
  AdjustedScene scene(0, 0.5);
  ASSERT_TRUE(scene.Adjust());
  for (const auto& [camera_id, camera] : scene.Model().Cameras()) {
    const colmap::Camera& truth = scene.TrueCamera(camera_id);
    // 2 % of the image size.
    EXPECT_NEAR(camera.PrincipalPointX(), truth.PrincipalPointX(), 16);
    EXPECT_NEAR(camera.PrincipalPointY(), truth.PrincipalPointY(), 16);
  }
}

// An image that is filtered out takes its camera with it.
TEST(KeepGroupsOf, DropsCamerasThatTheModelHasNot) {
  colmap::Reconstruction model;
  for (const colmap::camera_t camera_id : {1, 2, 3}) {
    colmap::Camera camera;
    camera.SetCameraId(camera_id);
    camera.InitializeWithName("SIMPLE_RADIAL", 500, 640, 480);
    model.AddCamera(camera);
  }
  std::vector<CameraGroup> groups(2);
  groups[0].camera_ids = {1, 2, 7};
  groups[1].camera_ids = {3, 8};
  KeepGroupsOf(model, &groups);
  ASSERT_EQ(groups.size(), 1);
  EXPECT_EQ(groups[0].camera_ids, (std::vector<colmap::camera_t>{1, 2}));
}

}  // namespace
}  // namespace dgsfm
