#include "sfm/joining/block_adjustment.h"

#include "colmap_ext/pose_access.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Cameras along a line that look at points beside it, in three blocks that
// overlap.
class BlockAdjustment : public testing::Test {
 protected:
  static constexpr int kNumImages = 30;
  static constexpr int kNumPointsPerImage = 12;
  static constexpr double kFocalLengthPx = 600;

  void SetUp() override {
    colmap::Camera camera;
    camera.SetCameraId(1);
    camera.SetModelIdFromName("SIMPLE_PINHOLE");
    camera.SetWidth(800);
    camera.SetHeight(600);
    camera.SetParams({kFocalLengthPx, 400, 300});
    model_.poses.AddCamera(camera);
    for (int i = 0; i < kNumImages; ++i) {
      colmap::Image image;
      image.SetImageId(i + 1);
      image.SetCameraId(1);
      image.SetName(std::to_string(i));
      SetCamFromWorld({Eigen::Quaterniond::Identity(), -CenterOf(i)}, &image);
      model_.poses.AddImage(image);
      model_.poses.RegisterImage(i + 1);
      model_.image_ids.push_back(i + 1);
    }
    AddPoints();
    AddBlock(0, 14);
    AddBlock(8, 24);
    AddBlock(18, kNumImages);
  }

  static Eigen::Vector3d CenterOf(int image) {
    return {double(image), 0.1 * std::sin(double(image)), 0};
  }

  // Each is seen by the five images around it.
  void AddPoints() {
    std::uniform_real_distribution<double> uniform(-1, 1);
    model_.begins.push_back(0);
    for (int i = 2; i + 2 < kNumImages; ++i) {
      for (int j = 0; j < kNumPointsPerImage; ++j) {
        const Eigen::Vector3d point(
            i + 0.5 * uniform(rng_), 2 * uniform(rng_), 8 + uniform(rng_));
        for (int image = i - 2; image <= i + 2; ++image) {
          const Eigen::Vector3d in_cam = point - CenterOf(image);
          const Eigen::Vector2d xy_px =
              kFocalLengthPx * in_cam.hnormalized() + Eigen::Vector2d(400, 300);
          model_.observations.push_back({uint32_t(image),
                                         colmap::point2D_t(model_.NumPoints()),
                                         xy_px.cast<float>()});
        }
        model_.points.push_back(point);
        model_.colors.emplace_back(0, 0, 0);
        model_.begins.push_back(model_.observations.size());
      }
    }
  }

  void AddBlock(uint32_t begin, uint32_t end) {
    std::vector<uint32_t>& block = model_.blocks.emplace_back();
    for (uint32_t i = begin; i < end; ++i) block.push_back(i);
  }

  // Moves the images from `first` on as a part does whose similarity is off.
  void MoveImages(int first, const Eigen::Vector3d& offset) {
    for (int i = first; i < kNumImages; ++i) {
      SetCenterInWorld(CenterOf(i) + offset, &model_.poses.Image(i + 1));
    }
    for (size_t point = 0; point < model_.NumPoints(); ++point) {
      const auto& middle = model_.observations[model_.begins[point] + 2];
      if (int(middle.image) >= first) model_.points[point] += offset;
    }
  }

  // Largest distance of a centre from its neighbour's by the truth.
  double LargestSeam() const {
    double largest = 0;
    for (int i = 1; i < kNumImages; ++i) {
      const auto center = [&](int image) {
        return CamFromWorld(model_.poses.Image(image + 1))
            .TargetOriginInSource();
      };
      largest = std::max(
          largest,
          (center(i) - center(i - 1) - CenterOf(i) + CenterOf(i - 1)).norm());
    }
    return largest;
  }

  std::mt19937 rng_;
  JoinedModel model_;
};

TEST_F(BlockAdjustment, LeavesAnExactModel) {
  const auto summary = AdjustBlocks({}, 1, {}, {}, &model_);
  ASSERT_TRUE(summary);
  EXPECT_TRUE(summary->converged);
  // Key points have 32 bits.
  EXPECT_LT(summary->final_robust_rms_px, 1e-4);
  EXPECT_LT(LargestSeam(), 1e-5);
  EXPECT_EQ(model_.point_errors_px.size(), model_.NumPoints());
}

TEST_F(BlockAdjustment, SpreadsTheErrorOfASeam) {
  MoveImages(16, {0.02, -0.03, 0.02});
  BlockAdjustmentOptions options;
  options.max_num_sweeps = 50;
  options.min_cost_decrease = 1e-6;
  const auto summary = AdjustBlocks(options, 2, {}, {}, &model_);
  ASSERT_TRUE(summary);
  EXPECT_GT(summary->num_sweeps, 1);
  EXPECT_EQ(summary->num_filtered, 0);
  // The seam of 0.04 gave errors of 3 px. Sweeps flatten what is longer than a
  // block slowly: a tenth of the seam is left to neighbours.
  EXPECT_LT(summary->final_robust_rms_px, 0.1);
  EXPECT_LT(LargestSeam(), 6e-3);
}

TEST_F(BlockAdjustment, RemovesWrongObservations) {
  model_.observations[100].xy_px.x() += 50;
  const size_t num_observations = model_.observations.size();
  const auto summary = AdjustBlocks({}, 1, {}, {}, &model_);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->num_filtered, 1);
  EXPECT_EQ(model_.observations.size(), num_observations - 1);
  EXPECT_EQ(model_.begins.back(), model_.observations.size());
  EXPECT_LT(summary->final_robust_rms_px, 1e-3);
}

// Two images of a frame keep their relative pose.
TEST_F(BlockAdjustment, FramesMoveTogether) {
  RigConstraints rigs;
  const Rigid3d second_from_first(Eigen::Quaterniond::Identity(),
                                  CenterOf(10) - CenterOf(11));
  rigs.frames[11] = {1, 1, Rigid3d()};
  rigs.frames[12] = {1, 2, second_from_first};
  MoveImages(11, {0.02, 0, 0});
  SetCamFromWorld(second_from_first * CamFromWorld(model_.poses.Image(11)),
                  &model_.poses.Image(12));
  ASSERT_TRUE(AdjustBlocks({}, 1, rigs, {}, &model_));
  const Rigid3d relative = CamFromWorld(model_.poses.Image(12)) *
                           CamFromWorld(model_.poses.Image(11)).Inverse();
  EXPECT_LT((relative.translation - second_from_first.translation).norm(),
            1e-12);
}

// Prior centres hold the frame that is free without them.
TEST_F(BlockAdjustment, PriorCentersHoldTheFrame) {
  CenterPriors priors;
  const Eigen::Vector3d offset(0.05, 0, 0);
  for (int i = 0; i < kNumImages; ++i) {
    priors.centers[i + 1] = {CenterOf(i) + offset,
                             Eigen::Matrix3d::Identity() / 1e-3};
  }
  BlockAdjustmentOptions options;
  options.max_num_sweeps = 50;
  options.min_cost_decrease = 0;
  ASSERT_TRUE(AdjustBlocks(options, 1, {}, priors, &model_));
  EXPECT_LT((CamFromWorld(model_.poses.Image(15)).TargetOriginInSource() -
             CenterOf(14) - offset)
                .norm(),
            0.01);
}

TEST(JoinedModel, KeepsPointsOfTwoOrMoreImages) {
  JoinedModel model;
  model.points = {{1, 0, 0}, {2, 0, 0}, {3, 0, 0}};
  model.colors.resize(3);
  model.begins = {0, 2, 5, 7};
  for (uint32_t i = 0; i < 7; ++i) model.observations.push_back({i, 0, {0, 0}});
  model.Keep({true, false, true, false, true, true, true});
  EXPECT_EQ(model.begins, (std::vector<size_t>{0, 2, 4}));
  ASSERT_EQ(model.NumPoints(), 2);
  EXPECT_EQ(model.points[0].x(), 2);
  EXPECT_EQ(model.points[1].x(), 3);
  EXPECT_EQ(model.observations[1].image, 4);
  EXPECT_EQ(model.observations[3].image, 6);
}

}  // namespace
}  // namespace dgsfm
