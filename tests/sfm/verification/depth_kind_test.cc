#include "sfm/verification/depth_kind.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

// Images of a wall, whose depth is smooth, as depth maps are.
class WrongDepthKind : public testing::Test {
 protected:
  WrongDepthKind() {
    SyntheticSceneOptions options;
    options.family = SceneFamily::FACADE;
    options.num_images = 8;
    options.num_points_per_image = 400;
    const SyntheticScene facade = SynthesizeScene(options);
    scene_ = SceneFromSynthetic(facade);
    depths_ = KeypointDepthsFromSynthetic(facade);
  }

  // Gives each key point what the map has at another place of the image, in
  // units of its size.
  void MoveDepths(
      const std::function<Eigen::Vector2d(const Eigen::Vector2d&)>& place) {
    for (auto& [image_id, of_image] : depths_) {
      const colmap::Image& image = scene_.images.at(image_id);
      const colmap::Camera& camera = scene_.cameras.at(image.CameraId());
      const Eigen::Vector2d size(camera.Width(), camera.Height());
      const std::vector<float> given = of_image.depths;
      for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
        const Eigen::Vector2d wanted =
            place(image.Point2D(i).XY().cwiseQuotient(size)).cwiseProduct(size);
        colmap::point2D_t nearest = 0;
        for (colmap::point2D_t j = 0; j < image.NumPoints2D(); ++j) {
          if (given[j] > 0 &&
              (image.Point2D(j).XY() - wanted).norm() <
                  (image.Point2D(nearest).XY() - wanted).norm()) {
            nearest = j;
          }
        }
        of_image.depths[i] = given[nearest];
      }
    }
  }

  std::string Explain() {
    PairVerificationOptions verification;
    verification.num_threads = 1;
    return ExplainWrongKindByPairs(
        scene_, VerifyPairs(scene_, depths_, verification), depths_);
  }

  Scene scene_;
  KeypointDepthMap depths_;
};

TEST_F(WrongDepthKind, RightMapsNeedNoExplanation) {
  EXPECT_THAT(Explain(), IsEmpty());
}

TEST_F(WrongDepthKind, MirroredMapsAreFoundByPairs) {
  MoveDepths([](const Eigen::Vector2d& place) {
    return Eigen::Vector2d(1 - place.x(), place.y());
  });
  EXPECT_THAT(Explain(), HasSubstr("mirrored"));
}

TEST_F(WrongDepthKind, DisparityIsFoundByPairs) {
  for (auto& [image_id, of_image] : depths_) {
    for (float& depth : of_image.depths) {
      if (depth > 0) depth = 1 / depth;
    }
  }
  EXPECT_THAT(Explain(), HasSubstr("as disparity does"));
}

TEST_F(WrongDepthKind, OneValueEverywhereIsNoDepth) {
  KeypointDepths& depths = depths_.begin()->second;
  EXPECT_FALSE(HasOneValue(depths));
  for (float& depth : depths.depths) depth = depth > 0 ? 2 : 0;
  EXPECT_TRUE(HasOneValue(depths));
  // Too few places to judge by.
  depths.depths.resize(10);
  EXPECT_FALSE(HasOneValue(depths));
}

// As of a laser scanner: one of 300 key points has a depth.
TEST(ConcordancesByArrangement, SparseMapsAreJudged) {
  colmap::Camera camera;
  camera.InitializeWithName("SIMPLE_PINHOLE", 900, 1000, 800);
  std::vector<Eigen::Vector2d> xys_px;
  KeypointDepths depths;
  MeasuredDepths measured;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d& xy_px =
        xys_px.emplace_back(7.3 * (i % 137), 5.4 * (i / 137));
    measured.push_back({colmap::point2D_t(i), 1 + xy_px.y()});
    depths.depths.push_back(i % 301 == 0 ? float(1 + xy_px.y()) : 0.f);
  }
  colmap::Image image;
  image.SetPoints2D(xys_px);
  const std::vector<double> concordances =
      ConcordancesByArrangement(image, camera, depths, {measured});
  EXPECT_GT(concordances[0], 0.9);
}

TEST_F(WrongDepthKind, TwoImagesShowNothing) {
  MoveDepths([](const Eigen::Vector2d& place) {
    return Eigen::Vector2d(1 - place.x(), place.y());
  });
  depths_ = {*depths_.begin(), *std::next(depths_.begin())};
  EXPECT_THAT(Explain(), IsEmpty());
}

}  // namespace
}  // namespace dgsfm
