// A model on its way through the stages, and where it starts from.

#pragma once

#include "estimators/position_alignment.h"
#include "sfm/intrinsics/camera_splitting.h"
#include "sfm/mapping/bundle_adjustment.h"
#include "sfm/mapping/track_selection.h"
#include "sfm/view_graph/component_averaging.h"

#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace dgsfm {

// A model on its way through the stages, and what is believed of its cameras.
struct ModelInProgress {
  colmap::Reconstruction model;
  ImageCameras cameras;
  CameraBeliefs beliefs;
  // Images that move together, once the poses in their rigs are known.
  RigConstraints rigs;
  // Positions of the images, once the model is in their frame, and how it came
  // there.
  CenterPriors center_priors;
  std::optional<Similarity3d> positions_from_start;
  // Tracks of which the model has had a part so far; null if it has all.
  std::shared_ptr<const std::vector<colmap::Track>> all_tracks;
  // Key points that may get observations.
  UsedKeypoints used_keypoints;
  // Whether the rays of its tracks hardly differ, or the start from one centre
  // was better: a principal point off by a pixel moves centres by their spread.
  bool has_little_parallax = false;
  // Scales of the loss of the final adjustments.
  LossScales final_loss_scales;
};

// Returns a model with first positions, the same each time.
using ModelStart = std::function<colmap::Reconstruction()>;

// Where a model can start from.
struct ModelStarts {
  ModelStart from_pairs;
  // All images at one centre; null where their rays show parallax.
  ModelStart from_one_center;
  // Whether the rays of tracks hardly differ.
  bool has_little_parallax = false;
  // Number of observations of the tracks that both have.
  size_t num_observations = 0;
  ImageScales depth_scales;
};

}  // namespace dgsfm
