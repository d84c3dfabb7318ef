#include "controllers/point_colors.h"

#include "colmap_ext/pose_access.h"
#include "tests/testing/test_dir.h"

#include <colmap/util/bitmap.h>

#include <string>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kWidth = 64;
constexpr int kHeight = 48;

// Red on the left, blue on the right.
void WriteImage(const std::string& path) {
  colmap::Bitmap bitmap;
  bitmap.Allocate(kWidth, kHeight, true);
  for (int x = 0; x < kWidth; ++x) {
    for (int y = 0; y < kHeight; ++y) {
      bitmap.SetPixel(x,
                      y,
                      x < kWidth / 2 ? colmap::BitmapColor<uint8_t>(200, 0, 0)
                                     : colmap::BitmapColor<uint8_t>(0, 0, 100));
    }
  }
  ASSERT_TRUE(bitmap.Write(path));
}

// Two images see a point on the left and one on the right each.
colmap::Reconstruction CreateModel(const std::string& extension) {
  colmap::Reconstruction model;
  colmap::Camera camera;
  camera.SetCameraId(1);
  camera.InitializeWithName("SIMPLE_PINHOLE", 60, kWidth, kHeight);
  model.AddCamera(camera);
  for (const colmap::image_t image_id : {1, 2}) {
    colmap::Image image;
    image.SetImageId(image_id);
    image.SetCameraId(1);
    image.SetName(std::to_string(image_id) + extension);
    image.SetPoints2D(std::vector<Eigen::Vector2d>{{10, 20}, {50, 20}});
    model.AddImage(image);
    model.RegisterImage(image_id);
  }
  for (const colmap::point2D_t point2D_idx : {0, 1}) {
    colmap::Track track;
    track.AddElement(1, point2D_idx);
    track.AddElement(2, point2D_idx);
    model.AddPoint3D(Eigen::Vector3d(0, 0, 1), track);
  }
  return model;
}

class PointColorsTest : public testing::TestWithParam<std::string> {
 protected:
  const std::string folder_ = CreateTestDir();
};

TEST_P(PointColorsTest, PointsHaveTheColorOfTheirObservations) {
  WriteImage(folder_ + "/1" + GetParam());
  WriteImage(folder_ + "/2" + GetParam());
  for (const int num_threads : {1, 2}) {
    colmap::Reconstruction model = CreateModel(GetParam());
    ExtractPointColors(folder_, num_threads, &model);
    // JPEG rounds colours to a few levels.
    constexpr double kTolerance = 4;
    EXPECT_LE(
        (model.Point3D(1).Color().cast<double>() - Eigen::Vector3d(200, 0, 0))
            .norm(),
        kTolerance);
    EXPECT_LE(
        (model.Point3D(2).Color().cast<double>() - Eigen::Vector3d(0, 0, 100))
            .norm(),
        kTolerance);
  }
}

TEST_P(PointColorsTest, ImagesThatCannotBeReadCountForNothing) {
  WriteImage(folder_ + "/1" + GetParam());
  colmap::Reconstruction model = CreateModel(GetParam());
  ExtractPointColors(folder_, 1, &model);
  EXPECT_GT(model.Point3D(1).Color(0), 100);
  ExtractPointColors(folder_ + "/nowhere", 1, &model);
  EXPECT_EQ(model.Point3D(1).Color(), Eigen::Vector3ub::Zero());
}

INSTANTIATE_TEST_SUITE_P(Formats,
                         PointColorsTest,
                         testing::Values(".jpg", ".png"));

}  // namespace
}  // namespace dgsfm
