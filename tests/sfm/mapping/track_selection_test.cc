#include "sfm/mapping/track_selection.h"

#include <algorithm>
#include <map>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Four images of 100 key points: a row of them at the top left, and the others
// spread over the image.
Scene CreateScene() {
  Scene scene;
  colmap::Camera camera;
  camera.SetCameraId(1);
  camera.InitializeWithName("SIMPLE_PINHOLE", 800, 800, 800);
  scene.cameras[1] = camera;
  for (colmap::image_t image_id = 1; image_id <= 4; ++image_id) {
    std::vector<Eigen::Vector2d> points;
    for (int i = 0; i < 100; ++i) {
      points.push_back(i < 50 ? Eigen::Vector2d(i, 5)
                              : Eigen::Vector2d(100 * (i % 8) + 50,
                                                100 * ((i / 8) % 8) + 50));
    }
    colmap::Image image;
    image.SetImageId(image_id);
    image.SetCameraId(1);
    image.SetPoints2D(points);
    scene.images[image_id] = image;
  }
  return scene;
}

colmap::Track TrackOf(const std::vector<colmap::image_t>& image_ids,
                      colmap::point2D_t point2D_idx) {
  colmap::Track track;
  for (const colmap::image_t image_id : image_ids) {
    track.AddElement(image_id, point2D_idx);
  }
  return track;
}

// 100 tracks of images 1 to 3, of which the last ten are seen in image 4, too.
std::vector<colmap::Track> CreateTracks() {
  std::vector<colmap::Track> tracks;
  for (colmap::point2D_t i = 0; i < 90; ++i) {
    tracks.push_back(TrackOf({1, 2, 3}, i));
  }
  for (colmap::point2D_t i = 90; i < 100; ++i) {
    tracks.push_back(TrackOf({1, 2, 3, 4}, i));
  }
  return tracks;
}

std::map<colmap::image_t, int> CountObservations(
    const std::vector<colmap::Track>& tracks) {
  std::map<colmap::image_t, int> counts;
  for (const colmap::Track& track : tracks) {
    for (const auto& element : track.Elements()) ++counts[element.image_id];
  }
  return counts;
}

TEST(SelectTracks, LongOnesThatSpreadOverTheImagesStay) {
  TrackOptions options;
  options.max_num_tracks = 40;
  const auto selected = SelectTracks(options, CreateScene(), CreateTracks());
  ASSERT_EQ(selected.size(), 40);
  size_t num_long = 0, num_in_row = 0;
  for (const colmap::Track& track : selected) {
    num_long += track.Length() == 4;
    num_in_row += track.Element(0).point2D_idx < 50;
  }
  EXPECT_EQ(num_long, 10);
  // All are in one part of the image, where one tells most.
  EXPECT_LT(num_in_row, 10);
}

TEST(SelectTracks, NoImageHasMoreThanItsBound) {
  TrackOptions options;
  options.max_num_observations_per_image = 30;
  std::vector<colmap::Track> tracks = CreateTracks();
  for (colmap::point2D_t i = 0; i < 50; ++i) {
    tracks.push_back(TrackOf({2, 4}, i));
  }
  const auto counts =
      CountObservations(SelectTracks(options, CreateScene(), tracks));
  for (const colmap::image_t image_id : {1, 2, 3}) {
    EXPECT_EQ(counts.at(image_id), 30) << image_id;
  }
  // What it shares with an image that is full has no room there.
  EXPECT_GT(counts.at(4), 10);
  EXPECT_LE(counts.at(4), 30);
}

TEST(SelectTracks, WeakPairsKeepTheirTracks) {
  TrackOptions options;
  options.max_num_tracks = 20;
  std::vector<colmap::Track> tracks;
  for (colmap::point2D_t i = 0; i < 90; ++i) {
    tracks.push_back(TrackOf({1, 2, 3}, i));
  }
  for (colmap::point2D_t i = 90; i < 95; ++i) {
    tracks.push_back(TrackOf({3, 4}, i));
  }
  const auto counts =
      CountObservations(SelectTracks(options, CreateScene(), tracks));
  // More than their share.
  EXPECT_GE(counts.at(4), 3);
}

TEST(SelectTracks, KeypointsOfOtherTracksAreNotUsed) {
  const UsedKeypoints used = KeypointsOf({TrackOf({1, 2}, 7)});
  EXPECT_TRUE(IsUsed(used, 1, 7));
  EXPECT_FALSE(IsUsed(used, 1, 6));
  EXPECT_FALSE(IsUsed(used, 1, 8));
  EXPECT_FALSE(IsUsed(used, 3, 7));
  EXPECT_TRUE(IsUsed({}, 3, 7));
}

}  // namespace
}  // namespace dgsfm
