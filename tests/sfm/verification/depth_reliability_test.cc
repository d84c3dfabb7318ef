#include "sfm/verification/depth_reliability.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

PairGeometry Confirmation() {
  PairGeometry pair;
  pair.status = PairStatus::VALID;
  pair.has_scale = true;
  pair.log_scale_stddev = 0.01;
  return pair;
}

PairGeometry Contradiction() {
  PairGeometry pair;
  pair.status = PairStatus::DEPTH_INCONSISTENT;
  return pair;
}

TEST(DepthReliability, MapThatMostPairsContradictIsOut) {
  PairGeometries pairs;
  for (const colmap::image_t image_id : {1, 2, 3}) {
    pairs[PairIdOfImages(image_id, 9)] = Contradiction();
  }
  pairs[PairIdOfImages(4, 5)] = Confirmation();
  pairs[PairIdOfImages(1, 4)] = Confirmation();
  // The pairs of image 9 speak against 1, 2 and 3 once each, which is not
  // enough, and not at all once the map of 9 is out.
  pairs[PairIdOfImages(1, 5)] = Contradiction();
  EXPECT_THAT(FindUnreliableDepths(pairs), ElementsAre(9));
}

TEST(DepthReliability, OneContradictionMayBeAFalsePair) {
  PairGeometries pairs;
  pairs[PairIdOfImages(1, 2)] = Contradiction();
  EXPECT_THAT(FindUnreliableDepths(pairs), IsEmpty());
}

TEST(DepthReliability, ConfirmedMapsStayAmongFalsePairs) {
  PairGeometries pairs;
  for (colmap::image_t image_id = 1; image_id <= 6; ++image_id) {
    for (colmap::image_t other = image_id + 1; other <= 6; ++other) {
      // Two places that look alike, with three images each.
      const bool same_place = (image_id <= 3) == (other <= 3);
      if (same_place) {
        pairs[PairIdOfImages(image_id, other)] = Confirmation();
      } else if (other == image_id + 3 || other == image_id + 4) {
        pairs[PairIdOfImages(image_id, other)] = Contradiction();
      }
    }
  }
  EXPECT_THAT(FindUnreliableDepths(pairs), IsEmpty());
}

TEST(DepthReliability, UncertainScaleConfirmsNothing) {
  PairGeometries pairs;
  for (colmap::image_t image_id = 2; image_id <= 4; ++image_id) {
    pairs[PairIdOfImages(1, image_id)] = Contradiction();
  }
  for (colmap::image_t image_id = 5; image_id <= 9; ++image_id) {
    PairGeometry pair = Confirmation();
    pair.log_scale_stddev = 0.1;
    pairs[PairIdOfImages(1, image_id)] = pair;
  }
  EXPECT_THAT(FindUnreliableDepths(pairs), ElementsAre(1));
}

// Scales may be uncertain throughout, as where focal lengths are unknown.
TEST(DepthReliability, MapThatAgreesWithMostStaysUnconfirmed) {
  PairGeometries pairs;
  for (colmap::image_t image_id = 1; image_id <= 5; ++image_id) {
    for (const colmap::image_t bad : {8, 9}) {
      pairs[PairIdOfImages(image_id, bad)] = Contradiction();
    }
    for (colmap::image_t other = image_id + 1; other <= 5; ++other) {
      PairGeometry pair = Confirmation();
      pair.log_scale_stddev = 0.1;
      pairs[PairIdOfImages(image_id, other)] = pair;
    }
  }
  EXPECT_THAT(FindUnreliableDepths(pairs), ElementsAre(8, 9));
}

// Unrelated maps of all images: the pairs of the last ones have no depth to
// contradict once the others are gone.
TEST(DepthReliability, NoMapStaysWhereAllContradictEachOther) {
  PairGeometries pairs;
  for (colmap::image_t image_id = 1; image_id <= 5; ++image_id) {
    for (colmap::image_t other = image_id + 1; other <= 5; ++other) {
      pairs[PairIdOfImages(image_id, other)] = Contradiction();
    }
  }
  EXPECT_THAT(FindUnreliableDepths(pairs), ElementsAre(1, 2, 3, 4, 5));
}

}  // namespace
}  // namespace dgsfm
