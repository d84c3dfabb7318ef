// Depth-guided global structure from motion (DGSfM Sec. 3): from verified
// pairs and depth at key points to one reconstruction per connected component.

#pragma once

#include "sfm/camera_calibration.h"
#include "sfm/camera_splitting.h"
#include "sfm/component_averaging.h"
#include "sfm/metric_scale.h"
#include "sfm/model_refinement.h"
#include "sfm/position_initialization.h"
#include "sfm/self_calibration.h"
#include "sfm/split_half.h"
#include "sfm/stage_report.h"
#include "sfm/track_establishment.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthGlobalMapperOptions {
  ViewGraphFilterOptions view_graph;
  ViewGraphCalibrationOptions view_graph_calibration;
  ComponentAveragingOptions averaging;
  TrackOptions tracks;
  PositionInitializationOptions position_initialization;
  ModelRefinementOptions refinement;
  CameraGroupingOptions camera_grouping;

  // Components and models with fewer images are left out.
  int min_model_size = 3;
  // Whether every component becomes a model, or only the largest.
  bool multiple_models = true;
  // Whether cameras that turn out to be the same become one in the models.
  bool share_intrinsics = false;
  // Whether images of one camera entry that turn out to have focal lengths of
  // their own get cameras of their own.
  bool split_cameras = true;
  // Whether the repeatability of the models is measured, see
  // SplitHalfRepeatability.
  bool measure_repeatability = false;
  // Threads of all stages; -1 = all cores.
  int num_threads = -1;

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
  bool skip_scale_averaging = false;
  // The filter of pairs by their translations, which the paper does not have.
  bool skip_translation_averaging = false;
  bool skip_global_positioning = false;
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
  // All matches that agree with the model are candidates of the completion,
  // else only the inliers of valid pairs.
  bool skip_match_completion = false;
  // The finished model has the last word on which pairs are valid.
  bool skip_pair_judging = false;

  bool IsValid(std::string* error) const;
};

struct DepthGlobalMapperResult {
  // Largest first; each has at least min_model_size registered images.
  std::vector<std::unique_ptr<colmap::Reconstruction>> models;
  // Of the models, in their order.
  std::vector<MeasuredUnit> units;
  std::vector<StageReport> stages;
  std::map<colmap::camera_t, CameraFocal> focals;
  std::map<colmap::camera_t, CameraResult> cameras;
  // Pairs that had left the view graph, and why, but agree with the finished
  // model: their matches are part of it, and they are VALID again.
  std::map<colmap::image_pair_t, PairStatus> readmitted_pairs;
  // Why each image of no model is missing.
  std::map<colmap::image_t, std::string> unregistered_images;
  // What may be wrong with the result, and the remedy, in sentences.
  std::vector<std::string> warnings;
  // Repeatability of the first model, with measure_repeatability.
  std::optional<PoseMetrics> repeatability;
  // Depth-map factors of the registered images against their model.
  std::map<colmap::image_t, double> depth_scales;
};

class DepthGlobalMapper {
 public:
  // `verification` is used for the second verification of the pairs. The
  // references must outlive the mapper; depth maps found unreliable count as
  // missing. Throws std::invalid_argument if the
  // options are not valid.
  DepthGlobalMapper(const DepthGlobalMapperOptions& options,
                    const PairVerificationOptions& verification,
                    const Scene& scene,
                    KeypointDepthMap depths,
                    const PairScores& pair_scores);

  // Maps the scene from verified pairs; pairs that leave the view graph get
  // their status.
  DepthGlobalMapperResult Run(PairGeometries* pairs);

 private:
  using ImageIds = std::vector<colmap::image_t>;

  // Leaves out the key points at rest where more pairs are valid without.
  void DropStaticBackground(PairGeometries* pairs);
  void DropUnreliableDepths(PairGeometries* pairs);
  // Verifies pairs once more, with other cameras or fewer depth maps.
  void VerifyAgain(const std::vector<colmap::image_pair_t>& pair_ids,
                   PairGeometries* pairs) const;
  void FilterPairs(PairGeometries* pairs);
  void CalibrateAndReverify(PairGeometries* pairs);
  std::optional<ComponentRotations> AverageRotationsOf(
      const ImageIds& image_ids, PairGeometries* pairs);
  ImageScales AverageScalesOf(const ImageIndex& index, PairGeometries* pairs);
  std::unique_ptr<colmap::Reconstruction> CreateModel(
      const ImageIndex& index,
      const std::vector<Eigen::Quaterniond>& cam_from_world_rotations) const;
  std::unique_ptr<colmap::Reconstruction> MapComponent(
      PairGeometries* pairs,
      const ImageIndex& index,
      const std::vector<Eigen::Quaterniond>& cam_from_world_rotations);
  // Global positioning and bundle adjustment of an initialized model, first
  // with shared intrinsics of all cameras that may be the same, and without
  // those that the model contradicts.
  bool RefineModel(CameraBeliefs* beliefs, colmap::Reconstruction* model);
  bool PositionModel(colmap::Reconstruction* model);
  bool AdjustModel(const CameraBeliefs& beliefs, colmap::Reconstruction* model);
  // Takes images out of the groups of their cameras, and out of their cameras.
  // Returns whether anything changed.
  bool Untie(const ImageIds& image_ids, CameraBeliefs* beliefs);
  // Gives each image of some cameras a camera of its own, with a warning.
  void SplitSharedCameras(const std::set<colmap::camera_t>& camera_ids);
  SelfCalibrationOptions SelfCalibration();
  void CalibrateCameras(CameraBeliefs* beliefs, colmap::Reconstruction* model);
  // Keeps images whose cameras ran away, by holding these.
  void HoldImplausibleCameras(CameraBeliefs* beliefs,
                              colmap::Reconstruction* model);
  // Whether cameras of one kind share their intrinsics.
  bool TiesCameras() const;
  // Calibrates and completes an adjusted model, and judges pairs by it.
  void CompleteModel(CameraBeliefs* beliefs,
                     PairGeometries* pairs,
                     colmap::Reconstruction* model);
  // The adjustment of the complete model and the filter of observations after
  // it, whose number it returns.
  size_t AdjustAgain(const CameraBeliefs& beliefs,
                     colmap::Reconstruction* model,
                     StageTimer* timer);
  // Whether an adjustment with FinalAdjustment() follows the first ones.
  bool HasFinalAdjustment() const;
  void RetriangulateModel(const CameraBeliefs& beliefs,
                          const PairGeometries& pairs,
                          colmap::Reconstruction* model);
  void MeasureRepeatability(const CameraBeliefs& beliefs,
                            const colmap::Reconstruction& model);
  // Of the adjustment of the complete model.
  BundleAdjustmentOptions FinalAdjustment() const;
  // Matches that tracks may be completed with.
  std::unique_ptr<colmap::CorrespondenceGraph> CandidateMatches(
      const PairGeometries& pairs, const colmap::Reconstruction& model) const;
  void JudgePairsByModel(const colmap::Reconstruction& model,
                         PairGeometries* pairs);
  // `start_centers` are those before positioning.
  void FinishModel(const ImageCenters& start_centers,
                   colmap::Reconstruction* model);
  // Says what the sorted models are measured in.
  void MeasureUnits();
  void ExplainMissingImages(const PairGeometries& pairs);
  void Warn(const std::string& warning);
  // Warns if nearly all pairs see planes, which leaves focal lengths open.
  void WarnOfPlanes(const PairGeometries& pairs);

  DepthGlobalMapperOptions options_;
  PairVerificationOptions verification_;
  // With averaged focal lengths.
  Scene scene_;
  // Of the cameras as given.
  CameraBeliefs beliefs_;
  // Entries of the cameras that split entries were divided into.
  CameraOrigins camera_origins_;
  KeypointDepthMap depths_;
  // Of the present component, by how well they agree at its start.
  DepthPriors depth_priors_;
  double final_loss_scale_px_ = 0;
  const PairScores& pair_scores_;
  DepthGlobalMapperResult result_;
};

}  // namespace dgsfm
