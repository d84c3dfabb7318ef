#include "sfm/mapping/track_establishment.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

PairGeometry PairWithMatches(const colmap::FeatureMatches& matches) {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.inlier_matches = matches;
  pair.depth_verified.resize(matches.size(), 1);
  return pair;
}

TrackOptions OnlyLongTracks() {
  TrackOptions options;
  options.min_num_tracks_per_view = 0;
  return options;
}

TEST(EstablishTracks, JoinsMatchesOverThreeImages) {
  PairGeometries pairs;
  pairs[PairIdOfImages(1, 2)] = PairWithMatches({{0, 5}, {1, 6}});
  pairs[PairIdOfImages(2, 3)] = PairWithMatches({{5, 9}});
  const auto tracks =
      EstablishTracks(ImageIndex({1, 2, 3}), pairs, OnlyLongTracks());
  ASSERT_EQ(tracks.size(), 1);
  ASSERT_EQ(tracks[0].Length(), 3);
  EXPECT_EQ(tracks[0].Element(0).image_id, 1);
  EXPECT_EQ(tracks[0].Element(2).point2D_idx, 9);
}

TEST(EstablishTracks, WeakestMatchOfAConflictIsLeftOut) {
  PairGeometries pairs;
  // Feature 0 of image 1 reaches feature 5 and, through image 3, feature 6 of
  // image 2. The pair (2, 3) is the weakest and loses.
  pairs[PairIdOfImages(1, 2)] = PairWithMatches({{0, 5}, {1, 7}, {2, 8}});
  pairs[PairIdOfImages(1, 3)] = PairWithMatches({{0, 9}, {1, 10}});
  pairs[PairIdOfImages(2, 3)] = PairWithMatches({{6, 9}});
  const auto tracks =
      EstablishTracks(ImageIndex({1, 2, 3}), pairs, OnlyLongTracks());
  ASSERT_EQ(tracks.size(), 2);
  EXPECT_EQ(tracks[0].Element(1).point2D_idx, 5);
  EXPECT_EQ(tracks[0].Element(2).point2D_idx, 9);
}

TEST(EstablishTracks, TwoViewTracksOnlyWhereLongOnesAreShort) {
  PairGeometries pairs;
  pairs[PairIdOfImages(1, 2)] = PairWithMatches({{0, 0}, {1, 1}});
  pairs[PairIdOfImages(2, 3)] = PairWithMatches({{0, 0}});
  const ImageIndex index({1, 2, 3});
  EXPECT_EQ(EstablishTracks(index, pairs, OnlyLongTracks()).size(), 1);
  TrackOptions options;
  options.min_num_tracks_per_view = 2;
  EXPECT_EQ(EstablishTracks(index, pairs, options).size(), 2);
}

TEST(EstablishTracks, IgnoresInvalidPairsAndOtherImages) {
  PairGeometries pairs;
  pairs[PairIdOfImages(1, 2)] = PairWithMatches({{0, 0}});
  pairs[PairIdOfImages(2, 3)] = PairWithMatches({{0, 0}});
  pairs[PairIdOfImages(2, 3)].status = PairStatus::ROTATION_OUTLIER;
  TrackOptions options;
  options.min_num_views_per_track = 2;
  EXPECT_EQ(EstablishTracks(ImageIndex({1, 2, 3}), pairs, options).size(), 1);
  EXPECT_TRUE(EstablishTracks(ImageIndex({1, 3}), pairs, options).empty());
}

}  // namespace
}  // namespace dgsfm
