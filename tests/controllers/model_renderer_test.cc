#include "controllers/model_renderer.h"

#include "tests/controllers/run_command.h"
#include "tests/testing/ring_model.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using Color = colmap::BitmapColor<uint8_t>;

class RenderModelTest : public testing::Test {
 protected:
  void Read(const colmap::Reconstruction& model) {
    const std::string folder = CreateTestDir();
    model.WriteBinary(folder);
    images_ = ReadModelImages(folder);
    cameras_ = ReadModelCameras(folder);
    points_ = ReadModelPoints(folder);
  }

  // Number of pixels that satisfy a condition on their colour, and whether
  // one of them is in the outermost rows or columns.
  template <typename Condition>
  static std::pair<int, bool> Count(const colmap::Bitmap& bitmap,
                                    const Condition& condition) {
    int count = 0;
    bool is_at_border = false;
    for (int y = 0; y < bitmap.Height(); ++y) {
      for (int x = 0; x < bitmap.Width(); ++x) {
        Color color;
        EXPECT_TRUE(bitmap.GetPixel(x, y, &color));
        if (!condition(color)) continue;
        ++count;
        is_at_border |= x == 0 || y == 0 || x == bitmap.Width() - 1 ||
                        y == bitmap.Height() - 1;
      }
    }
    return {count, is_at_border};
  }

  static bool IsBackground(const Color& color) {
    return color == Color(22, 25, 32);
  }

  std::map<std::string, ModelImage> images_;
  std::map<colmap::camera_t, colmap::Camera> cameras_;
  std::vector<ModelPoint> points_;
};

TEST_F(RenderModelTest, ShowsPointsAndCamerasInsideThePicture) {
  Read(CreateRingModel(5));
  for (ModelPoint& point : points_) point.color = Eigen::Vector3ub(0, 255, 0);
  const colmap::Bitmap bitmap =
      RenderModel(images_, cameras_, points_, 160, 120);
  EXPECT_EQ(bitmap.Width(), 160);
  EXPECT_EQ(bitmap.Height(), 120);
  const auto [num_green, green_at_border] = Count(
      bitmap, [](const Color& color) { return color.g > 2 * color.r + 50; });
  const auto [num_drawn, drawn_at_border] =
      Count(bitmap, [](const Color& color) { return !IsBackground(color); });
  EXPECT_GE(num_green, 5);
  EXPECT_GT(num_drawn, 3 * num_green);  // 40 edges, five points
  EXPECT_FALSE(drawn_at_border);
}

TEST_F(RenderModelTest, IsDeterministic) {
  Read(CreateRingModel(4));
  const std::vector<uint8_t> first =
      RenderModel(images_, cameras_, points_, 64, 48).ConvertToRowMajorArray();
  EXPECT_EQ(
      RenderModel(images_, cameras_, points_, 64, 48).ConvertToRowMajorArray(),
      first);
}

TEST_F(RenderModelTest, FarOutliersDoNotShrinkTheRest) {
  Read(CreateRingModel(4));
  points_.resize(1);
  points_.resize(100, points_[0]);
  const auto is_drawn = [](const Color& color) { return !IsBackground(color); };
  const int num_drawn =
      Count(RenderModel(images_, cameras_, points_, 80, 60), is_drawn).first;
  points_[0].xyz = Eigen::Vector3d(1e9, -1e9, 1e9);
  points_[1].xyz = -points_[0].xyz;
  // The outliers themselves may show as dots of up to four pixels each.
  EXPECT_NEAR(
      Count(RenderModel(images_, cameras_, points_, 80, 60), is_drawn).first,
      num_drawn,
      8);
}

TEST_F(RenderModelTest, DegenerateModelsAreDrawn) {
  Read(CreateRingModel(1));
  const auto is_drawn = [](const Color& color) { return !IsBackground(color); };
  const auto num_drawn = [&] {
    return Count(RenderModel(images_, cameras_, points_, 80, 60), is_drawn)
        .first;
  };
  EXPECT_GT(num_drawn(), 0);
  points_.clear();
  cameras_.clear();
  EXPECT_GT(num_drawn(), 0);
  // All points in the centre of the only camera.
  points_.resize(
      3, {images_.begin()->second.cam_from_world.TargetOriginInSource()});
  EXPECT_GT(num_drawn(), 0);
  images_.clear();
  EXPECT_THROW(RenderModel(images_, cameras_, points_, 80, 60),
               std::invalid_argument);
}

TEST(RunModelRenderer, WritesPngOrSaysWhyNot) {
  const std::string dir = CreateTestDir();
  CreateRingModel(3).WriteText(dir);
  const auto run = [&dir](const std::string& output_path,
                          const std::string& width) {
    return RunForTest(&RunModelRenderer,
                      {"--input_path",
                       dir,
                       "--output_path",
                       output_path,
                       "--width",
                       width,
                       "--height",
                       "32"});
  };
  const std::string path = dir + "/model.png";
  EXPECT_EQ(run(path, "48").code, 0);
  colmap::Bitmap bitmap;
  ASSERT_TRUE(bitmap.Read(path));
  EXPECT_EQ(bitmap.Width(), 48);
  EXPECT_EQ(bitmap.Height(), 32);

  EXPECT_EQ(run(path, "0").code, 2);
  EXPECT_EQ(run(path, "100000").code, 2);
  const CommandResult unwritable = run(dir + "/none/model.png", "48");
  EXPECT_EQ(unwritable.code, 1);
  EXPECT_THAT(unwritable.err, testing::HasSubstr(dir + "/none/model.png"));
  colmap::Reconstruction().WriteText(dir);
  EXPECT_EQ(run(path, "48").code, 1);
}

}  // namespace
}  // namespace dgsfm
