#include "sfm/mapping/model_adjustment.h"

#include "sfm/mapping/model_access.h"
#include "sfm/mapping/model_refinement.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/mapping/shared_center.h"

#include <algorithm>

namespace dgsfm {

namespace {

// Relative decrease by an iteration that ends adjustments before the model is
// complete.
constexpr double kPreliminaryFunctionTolerance = 1e-4;
// Factor of the tolerance where there is little parallax.
constexpr double kToleranceFactorInValleys = 1e-4;

}  // namespace

colmap::image_t AnchorImage(const colmap::Reconstruction& model) {
  const std::vector<colmap::image_t> image_ids = SortedRegisteredImages(model);
  return *std::max_element(
      image_ids.begin(),
      image_ids.end(),
      [&](colmap::image_t image_id1, colmap::image_t image_id2) {
        return model.Image(image_id1).NumPoints3D() <
               model.Image(image_id2).NumPoints3D();
      });
}

RigConstraints CurrentRigs(const MappingContext& context,
                           const RigConstraints& rigs,
                           const colmap::Reconstruction& model) {
  if (rigs.refined_cameras.empty()) return rigs;
  RigConstraints current = rigs;
  current.frames =
      MembersOf(CalibrateRigs(rigs.refined_cameras, model, context.scene.rigs));
  return current;
}

void FollowValleys(const ModelInProgress& progress,
                   BundleAdjustmentOptions* adjustment) {
  if (progress.has_little_parallax) {
    adjustment->function_tolerance *= kToleranceFactorInValleys;
  }
}

std::optional<double> Adjust(const MappingContext& context,
                             const BundleAdjustmentOptions& adjustment,
                             const CameraBeliefs& beliefs,
                             const RigConstraints& rigs,
                             const CenterPriors& center_priors,
                             colmap::Reconstruction* model) {
  return AdjustBundle(adjustment,
                      context.verification.num_threads,
                      AnchorImage(*model),
                      beliefs,
                      model,
                      CurrentRigs(context, rigs, *model),
                      center_priors);
}

bool AdjustModel(const MappingContext& context,
                 ModelInProgress* progress,
                 MappingLog* log) {
  colmap::Reconstruction& model = progress->model;
  const DepthGlobalMapperOptions& options = context.options;
  if (options.skip_bundle_adjustment) return true;
  const int num_rounds = options.refinement.num_bundle_adjustment_rounds;
  BundleAdjustmentOptions adjustment = options.refinement.bundle_adjustment;
  FollowValleys(*progress, &adjustment);
  if (options.HasFinalAdjustment() && !progress->has_little_parallax) {
    adjustment.function_tolerance =
        std::max(adjustment.function_tolerance, kPreliminaryFunctionTolerance);
  }
  for (int round = 0; round < num_rounds; ++round) {
    StageTimer timer("bundle_adjustment");
    if (progress->has_little_parallax) MoveStuckPoints(&model);
    const std::optional<double> rms = Adjust(context,
                                             adjustment,
                                             progress->beliefs,
                                             progress->rigs,
                                             progress->center_priors,
                                             &model);
    if (!rms) return false;
    // Early rounds still show errors of the start, which must not cost points.
    const size_t num_filtered =
        FilterObservations(options.refinement, num_rounds - round, &model);
    timer.Add("round", round + 1)
        .Add("rms_px", *rms)
        .Add("observations_filtered", double(num_filtered))
        .Add("points", double(model.NumPoints3D()));
    timer.Finish(&log->stages);
  }
  return model.NumPoints3D() > 0;
}

}  // namespace dgsfm
