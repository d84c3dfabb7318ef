#include "sfm/memory_prediction.h"

#include "tests/testing/expect_error.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

MappingSize LargeSize() {
  MappingSize size;
  size.num_images = 10000;
  size.num_keypoints = 80000000;
  size.num_pairs = 200000;
  size.num_matches = 100000000;
  size.num_matched_keypoints.assign(10000, 5000);
  return size;
}

TEST(CheckMemory, NamesTheBoundThatMakesItFit) {
  const MappingSize size = LargeSize();
  TrackOptions options;
  const double needed_gb = PredictMemoryGb(options, size);
  const double limit_gb = 0.8 * needed_gb;
  CheckMemory(1.01 * needed_gb, options, size);
  std::string message;
  try {
    CheckMemory(limit_gb, options, size);
  } catch (const std::runtime_error& error) {
    message = error.what();
  }
  const std::string option = "--max_num_observations_per_image ";
  ASSERT_NE(message.find(option), std::string::npos) << message;
  options.max_num_observations_per_image =
      std::stoi(message.substr(message.find(option) + option.size()));
  EXPECT_GT(options.max_num_observations_per_image, 1000);
  EXPECT_LT(options.max_num_observations_per_image, 5000);
  CheckMemory(limit_gb, options, size);
}

TEST(CheckMemory, TooManyKeypointsHaveAnotherRemedy) {
  ExpectError([] { CheckMemory(1, TrackOptions(), LargeSize()); },
              "--max_num_keypoints_per_image");
}

TEST(PredictMemoryGb, GrowsWithWhatIsUsed) {
  MappingSize size = LargeSize();
  TrackOptions bounded;
  bounded.max_num_observations_per_image = 1000;
  EXPECT_LT(PredictMemoryGb(bounded, size), PredictMemoryGb({}, size));
  bounded.max_num_observations_per_image = 6000;
  EXPECT_EQ(PredictMemoryGb(bounded, size), PredictMemoryGb({}, size));
}

TEST(PredictMemoryGb, CamerasOfTheirOwnMakeTheFactorLarger) {
  MappingSize size;
  size.num_images = 1000;
  size.num_factor_blocks = 1e6;
  size.num_cameras = 0;
  const double by_poses_gb = PredictMemoryGb({}, size);
  size.num_cameras = size.num_images;
  // Factor and matrix, 8 bytes an entry, of 10 columns an image instead of 6.
  EXPECT_NEAR(
      PredictMemoryGb({}, size) - by_poses_gb, (100 - 36) * 2 * 8e-3, 1e-9);
}

}  // namespace
}  // namespace dgsfm
