// Options of global mapping: those of its stages, and switches that leave
// single stages out.

#pragma once

#include "sfm/georeferencing/georeferencing_options.h"
#include "sfm/intrinsics/camera_calibration.h"
#include "sfm/mapping/model_refinement.h"
#include "sfm/mapping/position_initialization.h"
#include "sfm/mapping/track_establishment.h"
#include "sfm/view_graph/component_averaging.h"
#include "sfm/view_graph/pair_filters.h"

#include <string>

namespace dgsfm {

struct DepthGlobalMapperOptions {
  ViewGraphFilterOptions view_graph;
  ComponentAveragingOptions averaging;
  TrackOptions tracks;
  PositionInitializationOptions position_initialization;
  ModelRefinementOptions refinement;
  GeoreferencingOptions georeferencing;

  // Components and models with fewer images are left out, unless the whole
  // scene has fewer.
  int min_model_size = 3;
  // Whether every component becomes a model, or only the largest.
  bool multiple_models = true;
  // Whether cameras that turn out to be the same become one in the models.
  bool share_intrinsics = false;
  // Whether images of one camera entry that turn out to have focal lengths of
  // their own get cameras of their own.
  bool split_cameras = true;
  // Whether known poses of cameras in their rigs stay refined; unknown ones,
  // and those that the model contradicts, always do.
  bool refine_sensor_from_rig = false;
  // Whether the repeatability of the models is measured, see
  // SplitHalfRepeatability.
  bool measure_repeatability = false;

  // Ablation: leave single stages out.
  // The search for what moves before a background at rest, and the
  // verification of its pairs without that; not in the paper.
  bool skip_static_background = false;
  // The search for depth maps that contradict nearly all pairs, and the
  // verification of their images' pairs without them; not in the paper.
  bool skip_depth_reliability = false;
  bool skip_pair_scores = false;
  bool skip_focal_averaging = false;
  // The second verification of the pairs with the averaged focal lengths,
  // which the paper does not have.
  bool skip_reverification = false;
  // The second verification, with averaged rotations, of the pairs without a
  // geometry or with another rotation; not in the paper.
  bool skip_rotation_recovery = false;
  bool skip_scale_averaging = false;
  // The filters of pairs by their translations, with the lengths of shared
  // points and of depth, and the start from the centres averaged with the
  // former; not in the paper.
  bool skip_translation_averaging = false;
  bool skip_global_positioning = false;
  // The second start from one centre, where there is little parallax, and the
  // centre that images share where nothing shows that they moved; not in the
  // paper.
  bool skip_one_center_start = false;
  bool skip_bundle_adjustment = false;
  // The following are not in the paper.
  // Self-calibration: ties between cameras, see below, and free principal
  // points (also refinement.refine_principal_point alone).
  bool skip_self_calibration = false;
  // Averaged focal lengths of cameras of one kind are drawn together, such
  // cameras share their intrinsics, and images that contradict theirs leave
  // them.
  bool skip_camera_ties = false;
  // The loss scale of the final adjustments by the model's errors.
  bool skip_loss_adaptation = false;
  // Completion of tracks after bundle adjustment.
  bool skip_retriangulation = false;
  // New poses for images whose matches contradict theirs, before tracks are
  // completed.
  bool skip_image_resection = false;
  // All matches that agree with the model are candidates of the completion,
  // else only the inliers of valid pairs.
  bool skip_match_completion = false;
  // The finished model has the last word on which pairs are valid.
  bool skip_pair_judging = false;

  // Whether cameras of one kind share their intrinsics.
  bool TiesCameras() const {
    return !skip_self_calibration && !skip_camera_ties;
  }
  // Whether the complete model is adjusted once more after the first rounds.
  bool HasFinalAdjustment() const {
    return !skip_self_calibration || !skip_loss_adaptation ||
           !skip_retriangulation;
  }

  bool IsValid(std::string* error) const;
};

}  // namespace dgsfm
