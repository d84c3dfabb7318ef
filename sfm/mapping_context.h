// What the stages of a mapping share.

#pragma once

#include "sfm/global_mapping_options.h"
#include "sfm/stage_report.h"

#include <string>
#include <vector>

namespace dgsfm {

// The input of all components, which none of them changes.
struct MappingContext {
  const DepthGlobalMapperOptions& options;
  const PairVerificationOptions& verification;
  const Scene& scene;
  const KeypointDepthMap& depths;
  // Images whose poses in their frames are known.
  const FrameMembers& frames;
  // The database's values and EXIF data of all cameras.
  const CameraBeliefs& camera_beliefs;
};

// Images that a model must have: those that the options ask for, or all of a
// smaller scene, at least two.
size_t MinModelSize(const MappingContext& context);

// What stages report while they run.
struct MappingLog {
  std::vector<StageReport> stages;
  // What may be wrong with the result, and the remedy, in sentences.
  std::vector<std::string> warnings;

  // Logs the warning and keeps it.
  void Warn(const std::string& warning);
};

}  // namespace dgsfm
