#include "controllers/report/model_summary.h"

#include "tests/testing/expect_error.h"
#include "tests/testing/test_dir.h"

#include <fstream>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Two images at the same place see points at a depth of 1 with a focal length
// of 100 px: point i is 10 i px right of the centre.
class ModelSummaryTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = CreateTestDir();
    std::ofstream(folder_ + "/cameras.txt")
        << "1 SIMPLE_PINHOLE 100 100 100 50 50\n";
    std::ofstream(folder_ + "/images.txt") << "1 1 0 0 0 0 0 0 1 b.jpg\n"
                                           << "50 50 1 60 50 2 70 51 3\n"
                                           << "2 1 0 0 0 0 0 0 1 a.jpg\n"
                                           << "53 54 1 60 50 2 1 1 -1\n";
    std::ofstream(folder_ + "/points3D.txt") << "3 0.2 0 1 7 8 9 0 1 2\n"
                                             << "1 0 0 1 1 2 3 0 1 0 2 0\n"
                                             << "2 0.1 0 1 4 5 6 0 1 1 2 1\n";
  }

  std::string folder_;
};

TEST_F(ModelSummaryTest, HasTheFiguresOfImagesAndModel) {
  const ModelSummary model = SummarizeModel(folder_, 10, 100);
  EXPECT_EQ(model.num_points, 3);
  EXPECT_EQ(model.num_observations, 5);
  ASSERT_EQ(model.images.size(), 2);
  const ImageSummary& image_b = model.images.at("b.jpg");
  EXPECT_EQ(image_b.num_points, 3);
  // Points in three cells of 10 x 10 px.
  EXPECT_EQ(image_b.coverage, 0.03);
  EXPECT_NEAR(image_b.median_error_px, 0, 1e-9);
  // One of the two observations of a.jpg is off by 3 and 4 px.
  EXPECT_NEAR(model.images.at("a.jpg").median_error_px, 5, 1e-9);
  EXPECT_NEAR(model.median_error_px, 0, 1e-9);
}

TEST_F(ModelSummaryTest, HistogramsCountAll) {
  const ModelSummary model = SummarizeModel(folder_, 10, 100);
  const std::vector<size_t>& errors = model.error_histogram;
  EXPECT_EQ(errors.front(), 3);
  // 1 px, which may round down, and the one beyond.
  EXPECT_EQ(errors[9] + errors[10], 1);
  EXPECT_EQ(errors.back(), 1);
  EXPECT_EQ(std::accumulate(errors.begin(), errors.end(), size_t(0)), 5);
  EXPECT_EQ(model.track_histogram[1], 1);
  EXPECT_EQ(model.track_histogram[2], 2);
}

TEST_F(ModelSummaryTest, ShowsPointsWithTheirTracks) {
  const ModelSummary model = SummarizeModel(folder_, 10, 100);
  ASSERT_EQ(model.shown_points.size(), 3);
  const ShownPoint& first = model.shown_points.front();
  EXPECT_EQ(first.point.point3D_id, 1);
  EXPECT_EQ(first.point.color, Eigen::Vector3ub(1, 2, 3));
  ASSERT_EQ(first.views.size(), 2);
  // a.jpg is the first image by name.
  EXPECT_EQ(first.views[0].image, 0);
  EXPECT_EQ(first.views[0].x, 135);  // 256 * 0.53
  EXPECT_EQ(first.views[0].y, 138);  // 256 * 0.54
  EXPECT_EQ(first.views[1].image, 1);
}

TEST_F(ModelSummaryTest, ThinsPointsButNoFigures) {
  for (const auto& [max_num_points, max_num_views] :
       std::vector<std::pair<size_t, size_t>>{{2, 100}, {10, 3}}) {
    const ModelSummary model =
        SummarizeModel(folder_, max_num_points, max_num_views);
    ASSERT_EQ(model.shown_points.size(), 2);
    EXPECT_EQ(model.shown_points[0].point.point3D_id, 1);
    EXPECT_EQ(model.shown_points[1].point.point3D_id, 3);
    EXPECT_EQ(model.shown_points[1].views.size(), 1);
    EXPECT_EQ(model.num_points, 3);
    EXPECT_EQ(model.images.at("b.jpg").num_points, 3);
  }
}

TEST_F(ModelSummaryTest, PointsBehindTheCameraCountAsFarOff) {
  std::ofstream(folder_ + "/points3D.txt") << "1 0 0 -1 1 2 3 0 1 0 2 0\n";
  const ModelSummary model = SummarizeModel(folder_, 10, 100);
  EXPECT_EQ(model.error_histogram.back(), 2);
}

TEST_F(ModelSummaryTest, EmptyModelsAndMissingCameras) {
  std::ofstream(folder_ + "/cameras.txt") << "";
  ExpectError([&] { SummarizeModel(folder_, 10, 100); },
              "image a.jpg has no camera");
  std::ofstream(folder_ + "/images.txt") << "";
  std::ofstream(folder_ + "/points3D.txt") << "";
  EXPECT_TRUE(SummarizeModel(folder_, 10, 100).images.empty());
}

}  // namespace
}  // namespace dgsfm
