// Depth-guided global structure from motion (DGSfM Sec. 3): from verified
// pairs and depth at key points to one model per connected component.

#pragma once

#include "sfm/component_store.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping_context.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthGlobalMapperResult {
  // Largest first; each has at least min_model_size registered images.
  std::vector<std::unique_ptr<colmap::Reconstruction>> models;
  // Units of the models, in their order.
  std::vector<MeasuredUnit> units;
  // How they lie to the positions of their images, in their order.
  std::vector<ModelGeoreference> georeferences;
  // Rigs and frames with the poses of cameras in rigs that the models have, in
  // their order.
  std::vector<RigScene> rigs;
  std::vector<StageReport> stages;
  std::map<colmap::camera_t, CameraFocal> focals;
  std::map<colmap::camera_t, CameraResult> cameras;
  // Why each image of no model is missing.
  std::map<colmap::image_t, std::string> unregistered_images;
  // What may be wrong with the result, and the remedy, in sentences.
  std::vector<std::string> warnings;
  // Repeatability of the first model, with measure_repeatability.
  std::optional<PoseMetrics> repeatability;
  // Maps that were not used, as they contradict their pairs.
  KeypointDepthMap dropped_depths;
  // Depth-map factors of the registered images against their model.
  std::map<colmap::image_t, double> depth_scales;
};

// Maps a scene from its verified pairs. Pairs that leave the view graph get
// their status, cameras of the scene their averaged focal lengths, matches at
// rest leave the scene, and unreliable maps leave `depths`. `verification` is
// for pairs that are verified once more; its threads are those of all stages.
// Components that the store has are not mapped again, all others kept in it.
// Throws std::invalid_argument if options are not valid.
DepthGlobalMapperResult RunGlobalMapping(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const PairScores& pair_scores,
    Scene* scene,
    KeypointDepthMap* depths,
    PairGeometries* pairs,
    ComponentStore* store = nullptr);

}  // namespace dgsfm
