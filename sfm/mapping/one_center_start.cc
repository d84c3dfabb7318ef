#include "sfm/mapping/one_center_start.h"

#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_access.h"
#include "sfm/mapping/model_adjustment.h"
#include "sfm/mapping/model_refinement.h"
#include "sfm/mapping/one_center_growth.h"
#include "sfm/mapping/shared_center.h"

#include <limits>
#include <utility>

namespace dgsfm {

namespace {

// Iterations of an adjustment while a model grows; those that follow go on.
constexpr int kMaxNumGrowthIterations = 100;
// Their relative decrease by an iteration: valleys are long where there is
// little parallax.
constexpr double kGrowthFunctionTolerance = 1e-6;
// Cost of an observation while a model grows, over that by the other start, at
// which it is given up: what is still held may lower it.
constexpr double kMaxCostRatio = 2;
// Cost of the model, over that by the other start, below which it is better. A
// good start from depth may cost some per cent more by chance; without one, the
// other costs at least twice as much.
constexpr double kMaxBetterCostRatio = 0.8;

// The cost of a model's observations, and of those of the start that it lost,
// as if they were off by as much as a filter lets pass [px^2].
double CostOfModel(const MappingContext& context,
                   size_t num_observations_of_start,
                   const colmap::Reconstruction& model) {
  const ModelRefinementOptions& options = context.options.refinement;
  const RobustLoss loss = options.bundle_adjustment.Loss();
  const double num_lost = double(num_observations_of_start) -
                          double(model.ComputeNumObservations());
  const double max_error_px = options.max_reprojection_error_px;
  return CostOfObservations(loss, model) +
         num_lost * loss.Cost(max_error_px * max_error_px);
}

// Takes over poses, points and cameras of a part of the model; the others lose
// theirs.
void TakeOver(const colmap::Reconstruction& part,
              colmap::Reconstruction* model) {
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    model->DeletePoint3D(point_id);
  }
  for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
    if (IsRegistered(part, image_id)) {
      SetCamFromWorld(CamFromWorld(part.Image(image_id)),
                      &model->Image(image_id));
    } else {
      model->DeRegisterImage(image_id);
    }
  }
  for (const auto& [camera_id, camera] : part.Cameras()) {
    model->Camera(camera_id).SetParams(camera.Params());
  }
  for (const colmap::point3D_t point_id : SortedPoints(part)) {
    const colmap::Point3D& point = part.Point3D(point_id);
    model->AddPoint3D(point.XYZ(), point.Track());
  }
}

// Adjusts a model whose images share a centre, first with this held; gives up
// once an observation costs more than max_cost.
bool AdjustFromOneCenter(const MappingContext& context,
                         double max_cost,
                         ModelInProgress* progress,
                         MappingLog* log) {
  const ModelRefinementOptions& options = context.options.refinement;
  RigConstraints turning;
  turning.at_one_center = true;
  // Positions and intrinsics together are open before there are points.
  CameraBeliefs beliefs = progress->beliefs;
  for (const auto& [camera_id, camera] : progress->model.Cameras()) {
    beliefs.held_cameras.insert(camera_id);
  }
  if (progress->model.NumPoints3D() == 0 || !Adjust(context,
                                                    options.bundle_adjustment,
                                                    beliefs,
                                                    turning,
                                                    {},
                                                    &progress->model)) {
    return false;
  }
  FilterObservationsByAngle(options.max_angular_error_deg, &progress->model);
  BundleAdjustmentOptions adjustment = options.bundle_adjustment;
  adjustment.max_num_iterations = kMaxNumGrowthIterations;
  adjustment.function_tolerance = kGrowthFunctionTolerance;
  colmap::Reconstruction grown =
      GrowFromOneCenter(progress->model, [&](colmap::Reconstruction* model) {
        MoveStuckPoints(model);
        if (!Adjust(context, adjustment, beliefs, progress->rigs, {}, model)) {
          return -1.0;
        }
        const double cost = CostOfObservations(adjustment.Loss(), *model);
        return cost > max_cost * double(model->ComputeNumObservations()) ? -1.0
                                                                         : cost;
      });
  if (grown.NumPoints3D() == 0) return false;
  TakeOver(grown, &progress->model);
  return AdjustModel(context, progress, log);
}

}  // namespace

ModelInProgress AtOneCenter(const ModelStarts& starts,
                            const ModelInProgress& progress) {
  ModelInProgress turned = progress;
  turned.has_little_parallax = true;
  turned.model = starts.from_one_center();
  UseCameras(progress.cameras, &turned.model);
  for (const auto& [camera_id, camera] : progress.model.Cameras()) {
    turned.model.Camera(camera_id).SetParams(camera.Params());
  }
  return turned;
}

bool ReplaceIfBetterFromOneCenter(const MappingContext& context,
                                  size_t num_observations_of_start,
                                  ModelInProgress turned,
                                  bool is_refined,
                                  ModelInProgress* progress,
                                  MappingLog* log) {
  StageTimer timer("start_from_one_center");
  const double other_cost =
      is_refined
          ? CostOfModel(context, num_observations_of_start, progress->model)
          : std::numeric_limits<double>::infinity();
  MappingLog details;
  if (!AdjustFromOneCenter(
          context,
          kMaxCostRatio * other_cost / double(num_observations_of_start),
          &turned,
          &details)) {
    return is_refined;
  }
  const double cost =
      CostOfModel(context, num_observations_of_start, turned.model);
  timer.Add("cost", cost).Add("points", double(turned.model.NumPoints3D()));
  if (is_refined) timer.Add("cost_of_other_start", other_cost);
  const bool is_better = cost < kMaxBetterCostRatio * other_cost;
  timer.Add("kept", is_better);
  timer.Finish(&log->stages);
  if (is_better) *progress = std::move(turned);
  return true;
}

void HoldOneCenter(const MappingContext& context,
                   const ImageScales& depth_scales,
                   ModelInProgress* progress,
                   MappingLog* log) {
  StageTimer timer("one_center");
  const ModelRefinementOptions& options = context.options.refinement;
  const RobustLoss loss = options.bundle_adjustment.Loss();
  RigConstraints turning;
  turning.at_one_center = true;
  colmap::Reconstruction model = progress->model;
  MoveToOneCenter(&model);
  if (!Adjust(context,
              options.bundle_adjustment,
              progress->beliefs,
              turning,
              {},
              &model)) {
    return;
  }
  const double cost = CostOfObservations(loss, model);
  const double free_cost = CostOfObservations(loss, progress->model);
  const bool is_held = IsExplainedByRotations(cost, free_cost, model);
  timer.Add("cost", cost).Add("cost_of_free_centers", free_cost);
  if (is_held) {
    progress->model = std::move(model);
    progress->rigs = turning;
    FilterObservations(options, 1.0, &progress->model);
    timer.Add(
        "points_with_depth",
        double(PlaceAtDepth(context.depths, depth_scales, &progress->model)));
  }
  timer.Add("held", is_held);
  timer.Finish(&log->stages);
}

}  // namespace dgsfm
