#include "sfm/mapping/stray_points.h"

#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/mapping/model_access.h"

#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A facade of exact points, every twentieth of which two images see.
class RemoveStrayPointsTest : public ::testing::Test {
 protected:
  RemoveStrayPointsTest() {
    SyntheticSceneOptions options;
    options.family = SceneFamily::FACADE;
    options.num_images = 10;
    options.num_points_per_image = 1000;
    options.image_noise_px = 0;
    model_ = ReconstructionFromSynthetic(SynthesizeScene(options));
    int count = 0;
    for (const colmap::point3D_t point_id : SortedPoints(model_)) {
      if (model_.Point3D(point_id).Track().Length() < 3) {
        model_.DeletePoint3D(point_id);
      } else if (++count % 20 == 0) {
        while (model_.Point3D(point_id).Track().Length() > 2) {
          const colmap::TrackElement element =
              model_.Point3D(point_id).Track().Element(0);
          model_.DeleteObservation(element.image_id, element.point2D_idx);
        }
        pairs_.push_back(point_id);
      }
    }
    num_points_ = model_.NumPoints3D();
  }

  // Half as far again from the first of its cameras.
  void Displace(colmap::point3D_t point_id) {
    colmap::Point3D& point = model_.Point3D(point_id);
    const Eigen::Vector3d center =
        model_.Image(point.Track().Element(0).image_id).ProjectionCenter();
    point.SetXYZ(center + 1.5 * (point.XYZ() - center));
  }

  size_t Remove(const ModelRefinementOptions& options = {},
                int num_threads = 1) {
    return RemoveStrayPoints(options, num_threads, &model_);
  }

  colmap::Reconstruction model_;
  std::vector<colmap::point3D_t> pairs_;
  size_t num_points_ = 0;
};

TEST_F(RemoveStrayPointsTest, KeepsPointsAmongTheirNeighbors) {
  ASSERT_GT(pairs_.size(), 10);
  EXPECT_EQ(Remove(), 0);
  EXPECT_EQ(model_.NumPoints3D(), num_points_);
}

TEST_F(RemoveStrayPointsTest, RemovesPointsBehindTheirNeighbors) {
  std::set<colmap::point3D_t> displaced;
  for (size_t i = 0; i < pairs_.size(); i += 3) {
    Displace(pairs_[i]);
    displaced.insert(pairs_[i]);
  }
  colmap::Reconstruction original = model_;
  EXPECT_EQ(Remove(), 2 * displaced.size());
  for (const colmap::point3D_t point_id : pairs_) {
    EXPECT_EQ(model_.ExistsPoint3D(point_id), displaced.count(point_id) == 0);
  }
  const colmap::Reconstruction of_one_thread = model_;
  model_ = original;
  Remove({}, 4);
  EXPECT_EQ(SortedPoints(model_), SortedPoints(of_one_thread));
}

TEST_F(RemoveStrayPointsTest, KeepsPointsOfThreeImages) {
  for (const colmap::point3D_t point_id : SortedPoints(model_)) {
    if (model_.Point3D(point_id).Track().Length() == 3) {
      Displace(point_id);
      break;
    }
  }
  EXPECT_EQ(Remove(), 0);
}

TEST_F(RemoveStrayPointsTest, KeepsPointsThatAreNotTriangulated) {
  Displace(pairs_[0]);
  ModelRefinementOptions options;
  options.min_triangulation_angle_deg = 90;
  EXPECT_EQ(Remove(options), 0);
}

TEST_F(RemoveStrayPointsTest, KeepsPointsWithoutNeighbors) {
  for (const colmap::point3D_t point_id : SortedPoints(model_)) {
    if (point_id != pairs_[0]) model_.DeletePoint3D(point_id);
  }
  ModelRefinementOptions options;
  options.min_num_triangulated_per_image = 0;
  EXPECT_EQ(Remove(options), 0);
}

TEST_F(RemoveStrayPointsTest, RatiosBelowOneAreInvalid) {
  ModelRefinementOptions options;
  std::string error;
  options.max_neighbor_distance_ratio = 0;
  EXPECT_TRUE(options.IsValid(&error));
  options.max_neighbor_distance_ratio = 0.5;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "max_neighbor_distance_ratio must be >= 1, but is 0.5");
}

TEST_F(RemoveStrayPointsTest, KeepsPointsWhereAnImageHasFewOthers) {
  Displace(pairs_[0]);
  ModelRefinementOptions options;
  options.min_num_triangulated_per_image = 10000;
  EXPECT_EQ(Remove(options), 0);
}

}  // namespace
}  // namespace dgsfm
