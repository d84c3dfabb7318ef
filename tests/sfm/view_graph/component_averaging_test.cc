#include "sfm/view_graph/component_averaging.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/verification/pair_verification.h"
#include "sfm/view_graph/translation_filter.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kNumImages = 8;
constexpr colmap::point2D_t kNumKeypoints = 100;

Eigen::Quaterniond Rotation(double angle_rad) {
  return Eigen::Quaterniond(
      Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitY()));
}

// Image i of a ring that looks outwards, with centre (i, i^2 / 10, 0).
Rigid3d CamFromWorld(int image) {
  const Eigen::Quaterniond rotation = Rotation(0.3 * image);
  const Eigen::Vector3d center(image, 0.1 * image * image, 0);
  return {rotation, -(rotation * center)};
}

double DepthScale(int image) { return 1 + 0.1 * image; }

// Exact pairs of images at most three apart; ids are image + 1.
struct Component {
  std::vector<colmap::image_t> image_ids;
  PairGeometries pairs;
  std::vector<Eigen::Quaterniond> rotations;
};

Component ExactComponent() {
  Component component;
  for (int i = 0; i < kNumImages; ++i) {
    component.image_ids.push_back(i + 1);
    component.rotations.push_back(CamFromWorld(i).rotation);
    for (int j = i + 1; j < kNumImages && j <= i + 3; ++j) {
      PairGeometry& pair = component.pairs[PairIdOfImages(i + 1, j + 1)];
      pair.status = PairStatus::VALID;
      pair.cam2_from_cam1 = CamFromWorld(j) * CamFromWorld(i).Inverse();
      pair.has_scale = true;
      pair.cam2_from_cam1.translation /= DepthScale(i);
      pair.scale_1_from_2 = DepthScale(j) / DepthScale(i);
      pair.num_matches = 110;
      for (colmap::point2D_t k = 0; k < kNumKeypoints; ++k) {
        pair.inlier_matches.emplace_back(k, k);
      }
    }
  }
  return component;
}

Scene SceneOf(const Component& component) {
  Scene scene;
  colmap::Camera& camera = scene.cameras[1];
  camera.InitializeWithName("SIMPLE_PINHOLE", 500, 640, 480);
  for (const colmap::image_t image_id : component.image_ids) {
    colmap::Image& image = scene.images[image_id];
    image.SetName(std::to_string(image_id) + ".jpg");
    image.SetCameraId(1);
    image.SetPoints2D(
        std::vector<Eigen::Vector2d>(kNumKeypoints, Eigen::Vector2d(320, 240)));
  }
  return scene;
}

PairGeometry& PairOf(Component* component, int image1, int image2) {
  return component->pairs.at(PairIdOfImages(image1 + 1, image2 + 1));
}

TEST(AverageComponentRotations, TakesOutWrongPairs) {
  Component component = ExactComponent();
  PairGeometry& wrong = PairOf(&component, 2, 4);
  wrong.cam2_from_cam1.rotation = Rotation(0.5) * wrong.cam2_from_cam1.rotation;
  const auto result = AverageComponentRotations(
      {}, Scene(), {}, component.image_ids, 1, &component.pairs);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->image_ids, component.image_ids);
  EXPECT_EQ(result->num_pairs_filtered, 1);
  EXPECT_EQ(wrong.status, PairStatus::ROTATION_OUTLIER);
  for (int i = 0; i < kNumImages; ++i) {
    // Exact data; the first image is the gauge.
    EXPECT_LT(result->cam_from_world[i].angularDistance(
                  component.rotations[i] * component.rotations[0].conjugate()),
              1e-6);
  }
}

TEST(AverageComponentRotations, ReturnsPartsThatAreCutOff) {
  Component component = ExactComponent();
  // The last two images hang on wrong pairs that contradict each other.
  for (int i = 0; i < kNumImages - 2; ++i) {
    for (int j = kNumImages - 2; j < kNumImages && j <= i + 3; ++j) {
      PairGeometry& pair = PairOf(&component, i, j);
      pair.cam2_from_cam1.rotation =
          Rotation(1.0 * i * j) * pair.cam2_from_cam1.rotation;
    }
  }
  ComponentAveragingOptions options;
  const auto result = AverageComponentRotations(options,
                                                SceneOf(component),
                                                {},
                                                component.image_ids,
                                                /*num_threads=*/1,
                                                &component.pairs);
  ASSERT_TRUE(result);
  size_t num_images = result->image_ids.size();
  for (const auto& part : result->other_parts) num_images += part.size();
  EXPECT_EQ(num_images, kNumImages);
  EXPECT_EQ(result->cam_from_world.size(), result->image_ids.size());
  for (const colmap::image_t image_id : {1, 2, 3, 4, 5, 6}) {
    EXPECT_TRUE(std::binary_search(
        result->image_ids.begin(), result->image_ids.end(), image_id));
  }
}

// The cameras of the rig look the same way, and the pairs contradict it: one
// frame has one rotation all the same.
TEST(AverageComponentRotations, OneFrameHasNothingToTurn) {
  Component component = ExactComponent();
  FrameMembers frames;
  for (const colmap::image_t image_id : component.image_ids) {
    frames[image_id].frame_id = 1;
  }
  const auto result = AverageComponentRotations({},
                                                SceneOf(component),
                                                frames,
                                                component.image_ids,
                                                /*num_threads=*/1,
                                                &component.pairs);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->image_ids, component.image_ids);
  EXPECT_GT(result->num_pairs_filtered, 3);
}

// A street whose images look ahead and pitch 2 degrees more from one to the
// next by their pairs, but are level by gravity. Each two are a rig, whose
// second camera is rolled: its gravity counts through its pose in the rig.
TEST(AverageComponentRotations, GravityOfRigsStraightensAStreet) {
  constexpr int kNumFrames = 12;
  const auto pitched = [](double angle_deg) {
    return Eigen::Quaterniond(
        Eigen::AngleAxisd(angle_deg * M_PI / 180, Eigen::Vector3d::UnitX()));
  };
  const Rigid3d rolled(
      Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ())),
      Eigen::Vector3d::UnitX());
  Component component;
  FrameMembers frames;
  Scene scene;
  for (int i = 0; i < kNumFrames; ++i) {
    const colmap::image_t first = 2 * i + 1;
    const colmap::image_t second = first + 1;
    component.image_ids.insert(component.image_ids.end(), {first, second});
    frames[first] = {frame_t(i), 1, Rigid3d()};
    frames[second] = {frame_t(i), 2, rolled};
    scene.pose_priors[second].gravity =
        rolled.rotation * Eigen::Vector3d::UnitY();
    // Without loops, the given standard deviations of pairs hold.
    for (int j = i + 1; j < kNumFrames && j <= i + 1; ++j) {
      PairGeometry& pair = component.pairs[PairIdOfImages(first, 2 * j + 1)];
      pair.status = PairStatus::VALID;
      pair.cam2_from_cam1.rotation = pitched(2 * (j - i));
      pair.num_matches = 110;
      pair.inlier_matches.resize(100);
    }
  }
  ComponentAveragingOptions options;
  options.gravity.use_gravity = true;
  const auto bend_deg = [&](const PosePriors& priors) {
    scene.pose_priors = priors;
    const auto result = AverageComponentRotations(
        options, scene, frames, component.image_ids, 1, &component.pairs);
    EXPECT_EQ(result->num_gravities, priors.size());
    return result->cam_from_world.front().angularDistance(
               result->cam_from_world[2 * kNumFrames - 2]) *
           180 / M_PI;
  };
  const PosePriors priors = scene.pose_priors;
  EXPECT_NEAR(bend_deg({}), 2 * (kNumFrames - 1), 1e-6);
  // Twelve pairs of 1 degree, and gravity that is off by up to 11 degrees.
  EXPECT_LT(bend_deg(priors), 0.8 * 2 * (kNumFrames - 1));
}

TEST(AverageComponentScales, MedianImageHasScaleOne) {
  Component component = ExactComponent();
  PairGeometry& wrong = PairOf(&component, 1, 3);
  wrong.scale_1_from_2 *= 3;
  const ComponentScales result = AverageComponentScales(
      {}, false, ImageIndex(component.image_ids), &component.pairs);
  EXPECT_EQ(result.num_outliers, 1);
  EXPECT_FALSE(wrong.has_scale);
  EXPECT_EQ(wrong.status, PairStatus::VALID);
  ASSERT_EQ(result.scales.size(), kNumImages);
  // The median of eight images is the mean of two, in logarithms.
  const double median = std::sqrt(DepthScale(3) * DepthScale(4));
  for (int i = 0; i < kNumImages; ++i) {
    // The wrong pair, off by 33 standard deviations, keeps a weight of 1e-4.
    EXPECT_NEAR(result.scales.at(i + 1), DepthScale(i) / median, 1e-4);
  }
}

TEST(AverageComponentScales, SkippedScalesAreOne) {
  Component component = ExactComponent();
  const ComponentScales result = AverageComponentScales(
      {}, true, ImageIndex(component.image_ids), &component.pairs);
  EXPECT_EQ(result.num_outliers, 0);
  for (const auto& [image_id, scale] : result.scales) EXPECT_EQ(scale, 1);
}

TEST(FilterByTranslation, TakesOutPairsOffTheirLoops) {
  Component component = ExactComponent();
  ImageScales scales;
  for (int i = 0; i < kNumImages; ++i) scales[i + 1] = DepthScale(i);
  PairGeometry& wrong = PairOf(&component, 3, 6);
  // The opposite direction, off by twice its length.
  wrong.cam2_from_cam1.translation *= -1;
  EXPECT_EQ(FilterByTranslation({},
                                ImageIndex(component.image_ids),
                                component.rotations,
                                scales,
                                &component.pairs),
            1);
  EXPECT_EQ(wrong.status, PairStatus::TRANSLATION_OUTLIER);
}

// Shifted views of a facade, some of which claim that their images did not
// move.
TEST(FilterByLength, TakesOutPairsOfLookAlikePlaces) {
  SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::REPEATS);
  options.num_images = 16;
  options.num_points_per_image = 300;
  options.image_noise_px = 0.5;
  const SyntheticScene synthetic = SynthesizeScene(options);
  const Scene scene = SceneFromSynthetic(synthetic);
  PairGeometries pairs = VerifyPairs(scene, {}, PairVerificationOptions());
  std::vector<colmap::image_t> image_ids;
  std::vector<Eigen::Quaterniond> rotations;
  for (const auto& [image_id, image] : synthetic.images) {
    image_ids.push_back(image_id);
    rotations.push_back(image.cam_from_world.rotation);
  }
  size_t num_valid_false = 0;
  for (const auto& [pair_id, pair] : pairs) {
    num_valid_false += pair.status == PairStatus::VALID &&
                       synthetic.pairs.at(pair_id).is_false;
  }
  EXPECT_GE(num_valid_false, 5);
  const LengthFilterResult result =
      FilterByLength({}, scene, ImageIndex(image_ids), rotations, 1, &pairs);
  // Pairs whose rays are parallel throughout have no length and stay.
  EXPECT_LE(result.num_pairs_filtered, num_valid_false);
  EXPECT_GE(4 * result.num_pairs_filtered, 3 * num_valid_false);
  EXPECT_EQ(result.centers.size(), 16);
  for (const auto& [pair_id, pair] : pairs) {
    if (synthetic.pairs.at(pair_id).is_false) continue;
    EXPECT_NE(pair.status, PairStatus::TRANSLATION_OUTLIER);
  }
}

TEST(FilterByLength, LeavesPairsWithoutInliersAlone) {
  Component component = ExactComponent();
  for (auto& [pair_id, pair] : component.pairs) pair.inlier_matches.clear();
  Scene scene;
  for (const colmap::image_t image_id : component.image_ids) {
    scene.images[image_id].SetImageId(image_id);
  }
  const LengthFilterResult result =
      FilterByLength({},
                     scene,
                     ImageIndex(component.image_ids),
                     component.rotations,
                     /*num_threads=*/1,
                     &component.pairs);
  EXPECT_EQ(result.num_pairs_filtered, 0);
  EXPECT_TRUE(result.centers.empty());
}

TEST(ComponentAveragingOptions, NamesTheInvalidField) {
  ComponentAveragingOptions options;
  std::string error;
  EXPECT_TRUE(options.IsValid(&error));
  options.max_translation_error_factor = 0.5;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "max_translation_error_factor must be >= 1, but is 0.5");
}

}  // namespace
}  // namespace dgsfm
