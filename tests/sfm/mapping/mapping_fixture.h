// A model on its way through the stages, with all that they share.

#pragma once

#include "sfm/mapping/model_in_progress.h"
#include "sfm/mapping_context.h"

#include <gtest/gtest.h>

namespace dgsfm {

class MappingFixture : public ::testing::Test {
 protected:
  DepthGlobalMapperOptions options_;
  PairVerificationOptions verification_;
  Scene scene_;
  KeypointDepthMap depths_;
  FrameMembers frames_;
  CameraBeliefs beliefs_;
  MappingContext context_{
      options_, verification_, scene_, depths_, frames_, beliefs_};
  PairGeometries pairs_;
  ModelInProgress progress_;
  MappingLog log_;
};

}  // namespace dgsfm
