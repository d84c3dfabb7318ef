#include "sfm/georeferencing/model_alignment.h"

#include "tests/testing/ring_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;

// Why positions of the first images of a ring, which are its centres in
// decimetres, z upwards, plus an offset of each, cannot be used.
std::string WhyUnusableWith(const std::vector<Eigen::Vector3d>& offsets) {
  const colmap::Reconstruction model = CreateRingModel(12);
  PosePriors priors;
  for (size_t i = 0; i < offsets.size(); ++i) {
    const colmap::image_t image_id = model.RegImageIds()[i];
    const Eigen::Vector3d center = model.Image(image_id).ProjectionCenter();
    PosePrior& prior = priors[image_id];
    prior.position =
        10 * Eigen::Vector3d(center.x(), center.z(), -center.y()) + offsets[i];
  }
  const GeoreferencingOptions options;
  return WhyUnusable(options,
                     priors,
                     AlignToPositions(options, priors, std::nullopt, model),
                     model);
}

TEST(WhyUnusable, DistinguishesFewPositionsFromContradictingOnes) {
  std::vector<Eigen::Vector3d> offsets(12, Eigen::Vector3d::Zero());
  EXPECT_EQ(WhyUnusableWith(offsets), "");
  EXPECT_THAT(WhyUnusableWith({offsets[0], offsets[0]}),
              HasSubstr("only 2 of these have one"));
  // One degree to the north.
  for (size_t i = 0; i < offsets.size(); i += 2) offsets[i].y() = 111e3;
  EXPECT_THAT(WhyUnusableWith(offsets),
              HasSubstr("contradict the shape of the model, with which 6 of 12 "
                        "agree"));
}

}  // namespace
}  // namespace dgsfm
