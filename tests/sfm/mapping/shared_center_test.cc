#include "sfm/mapping/shared_center.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/mapping/model_access.h"

#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Images in a row along a wall, each point about as far away as the next.
class LowParallaxModel : public testing::Test {
 protected:
  LowParallaxModel() {
    SyntheticSceneOptions options;
    options.family = SceneFamily::LOW_PARALLAX;
    options.num_images = 6;
    options.num_points_per_image = 50;
    options.image_noise_px = 0;
    model_ = ReconstructionFromSynthetic(SynthesizeScene(options));
    point_id_ = SortedPoints(model_).front();
    xyz_ = model_.Point3D(point_id_).XYZ();
  }

  Eigen::Vector3d FirstCenter() const {
    return model_.Image(model_.Point3D(point_id_).Track().Element(0).image_id)
        .ProjectionCenter();
  }

  // Moves the point away from its first image, or towards it.
  void MoveTo(double factor) {
    model_.Point3D(point_id_).SetXYZ(FirstCenter() +
                                     factor * (xyz_ - FirstCenter()));
  }

  // Distance of the point from its first image over its true one.
  double Ratio() const {
    return (model_.Point3D(point_id_).XYZ() - FirstCenter()).norm() /
           (xyz_ - FirstCenter()).norm();
  }

  colmap::Reconstruction model_;
  colmap::point3D_t point_id_ = 0;
  Eigen::Vector3d xyz_;
};

TEST_F(LowParallaxModel, LeavesPointsThatAreNotStuck) {
  EXPECT_EQ(MoveStuckPoints(&model_), 0);
  MoveTo(4);
  EXPECT_EQ(MoveStuckPoints(&model_), 0);
  EXPECT_NEAR(Ratio(), 4, 1e-9);
}

TEST_F(LowParallaxModel, MovesPointsToTheMedianDistanceAlongTheirRays) {
  for (const double factor : {1e12, 1e-6}) {
    MoveTo(factor);
    EXPECT_EQ(MoveStuckPoints(&model_), 1);
    // Walls are 2 to 8 m away.
    EXPECT_GT(Ratio(), 0.2);
    EXPECT_LT(Ratio(), 5);
    const Eigen::Vector3d before = xyz_ - FirstCenter();
    const Eigen::Vector3d after =
        model_.Point3D(point_id_).XYZ() - FirstCenter();
    // Baselines of 10 cm are seen under 3 degrees at most.
    EXPECT_GT(before.normalized().dot(after.normalized()),
              std::cos(5 * M_PI / 180));
  }
}

TEST_F(LowParallaxModel, LosesPointsWithoutDistance) {
  const size_t num_points = model_.NumPoints3D();
  // Points that the family shows are seen under half a degree and more.
  EXPECT_EQ(RemovePointsWithoutDistance(&model_), 0);
  MoveTo(1e6);
  EXPECT_EQ(RemovePointsWithoutDistance(&model_), 1);
  EXPECT_EQ(model_.NumPoints3D(), num_points - 1);
  EXPECT_FALSE(model_.ExistsPoint3D(point_id_));
}

TEST_F(LowParallaxModel, KeepsPointsOfOneCenter) {
  MoveToOneCenter(&model_);
  EXPECT_EQ(RemovePointsWithoutDistance(&model_), 0);
}

TEST_F(LowParallaxModel, NeedsNoPoints) {
  colmap::Reconstruction empty;
  EXPECT_EQ(MoveStuckPoints(&empty), 0);
}

}  // namespace
}  // namespace dgsfm
