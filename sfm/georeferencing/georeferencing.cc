#include "sfm/georeferencing/georeferencing.h"

#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_refinement.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>
#include <string>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Maps that count for it; more have errors in common.
constexpr double kMaxNumDepthMaps = 20;
// Positioning with priors is repeated while their errors shrink by this factor,
// at most so often.
constexpr double kMinShrinkage = 0.8;
constexpr int kMaxNumRounds = 3;
// Guessed standard deviations may turn out to be this much too large.
constexpr double kMinStddevFactor = 0.05;
// Factor between the scales by positions and by rigs at which these contradict
// each other, beyond three standard deviations: models that bend are off by
// less.
constexpr double kMaxRigScaleRatio = 1.5;

// Unit of the depth maps in that of the model, by metric maps.
struct DepthScaleOfModel {
  double scale = 0;
  double log_stddev = 0;
};

std::optional<DepthScaleOfModel> MeasureDepthScale(
    const KeypointDepthMap& depths, const colmap::Reconstruction& model) {
  const MeasuredUnit unit = UnitOfModel(depths, model);
  if (unit.unit != ModelUnit::METRES) return std::nullopt;
  return DepthScaleOfModel{
      std::exp(unit.log_scale),
      std::hypot(
          kMinDepthScaleStddev,
          unit.log_spread /
              std::sqrt(std::min(kMaxNumDepthMaps, double(unit.num_images))))};
}

// The scale of the positions where rigs fix it: their unit is metres, too.
std::optional<double> ScaleByRigs(const ModelInProgress& progress) {
  if (progress.rigs.fix_scale) return 1.0;
  return std::nullopt;
}

// Why positions cannot be used for a model whose scale rigs fix, by the
// alignment with a free scale; empty if they can.
std::string WhyNotWithRigs(const ModelInProgress& progress,
                           const std::optional<PositionAlignment>& free) {
  if (!progress.rigs.fix_scale || !free) return "";
  const double scale = free->target_from_source.scale;
  if (std::abs(std::log(scale)) <=
      std::log(kMaxRigScaleRatio) + 3 * free->log_scale_stddev) {
    return "";
  }
  std::ostringstream text;
  text << std::setprecision(3)
       << "the baselines of the rigs would have to be multiplied with " << scale
       << " to agree with them. Do so, or leave the unit to the positions "
          "(--DepthGlobalMapper.refine_sensor_from_rig 1)";
  return text.str();
}

double SpreadOf(const CenterPriors& priors,
                const colmap::Reconstruction& model) {
  return SpreadOfErrors(CenterErrors(priors, model));
}

// Factor of the given standard deviations with which they explain the errors:
// above one, or, where they are guesses, below.
double StddevFactor(const PosePriors& priors, double spread) {
  const size_t num_known =
      std::count_if(priors.begin(), priors.end(), [](const auto& prior) {
        return prior.second.has_covariance;
      });
  return std::max(2 * num_known > priors.size() ? 1 : kMinStddevFactor, spread);
}

// Turns the vertical to the z axis.
void StandUpright(const MappingContext& context,
                  colmap::Reconstruction* model) {
  const auto up = UpOfModel(
      context.options.georeferencing, context.scene.pose_priors, *model);
  if (!up || (!up->is_by_gravity &&
              !context.options.georeferencing.upright_by_level_cameras)) {
    return;
  }
  Similarity3d upright;
  upright.rotation = Eigen::Quaterniond::FromTwoVectors(
      up->in_world, Eigen::Vector3d::UnitZ());
  TransformModel(upright, model);
  LOG(INFO) << "The model of " << model->NumRegImages()
            << " images stands upright by "
            << (up->is_by_gravity ? "gravity" : "cameras held level")
            << " (median deviation " << up->spread_rad * 180 / M_PI << " deg)";
}

// Puts a model in metres by depth or by rigs at the positions of its images.
void PlaceByPositions(const MappingContext& context,
                      ModelInProgress* progress,
                      ModelGeoreference* result,
                      MappingLog* log) {
  const GeoreferencingOptions& options = context.options.georeferencing;
  colmap::Reconstruction* model = &progress->model;
  const bool is_by_rigs = progress->rigs.fix_scale;
  const PosePriors& priors = context.scene.pose_priors;
  const auto free = AlignToPositions(options, priors, std::nullopt, *model);
  const auto depth = MeasureDepthScale(context.depths, *model);
  std::string reason = WhyNotWithRigs(*progress, free);
  const bool contradicts_rigs = !reason.empty();
  if (!contradicts_rigs) reason = WhyUnusable(options, priors, free, *model);
  if (!free || contradicts_rigs || !(depth || is_by_rigs)) {
    if (!reason.empty()) log->Warn(UnusablePositionsText(reason, *model));
    return;
  }
  const auto placed = AlignToPositions(options, priors, 1.0, *model);
  if (!placed) return;
  result->SetAlignment(*placed);
  result->log_scale_stddev_of_positions = free->log_scale_stddev;
  if (depth) {
    result->scale_of_depth =
        1 / (depth->scale * free->target_from_source.scale);
    result->log_scale_stddev_of_depth = depth->log_stddev;
  }
  result->scale_source = is_by_rigs ? ScaleSource::RIGS : ScaleSource::DEPTH;
  if (is_by_rigs) result->scale_of_rigs = 1 / free->target_from_source.scale;
  if (!options.georeference) return;
  TransformModel(placed->target_from_source, model);
  result->is_georeferenced = true;
}

}  // namespace

void UsePositions(const MappingContext& context,
                  colmap::image_t fixed_image,
                  ModelInProgress* progress,
                  MappingLog* log) {
  progress->center_priors = CenterPriors();
  progress->positions_from_start.reset();
  const GeoreferencingOptions& options = context.options.georeferencing;
  const PosePriors& priors = context.scene.pose_priors;
  if (!options.use_positions || !HasPositions(priors)) return;
  StageTimer timer("position_priors");
  colmap::Reconstruction& model = progress->model;
  const auto free = AlignToPositions(options, priors, std::nullopt, model);
  if (!WhyNotWithRigs(*progress, free).empty() ||
      !WhyUnusable(options, priors, free, model).empty()) {
    return;
  }
  const auto alignment =
      progress->rigs.fix_scale
          ? AlignToPositions(options, priors, ScaleByRigs(*progress), model)
          : free;
  if (!alignment) return;
  const auto depth = MeasureDepthScale(context.depths, model);
  if (depth && !progress->rigs.fix_scale &&
      depth->log_stddev < alignment->log_scale_stddev) {
    return;
  }

  TransformModel(alignment->target_from_source, &model);
  progress->positions_from_start = alignment->target_from_source;
  CenterPriors center_priors = CenterPriorsOf(options, priors, 1, model);
  double spread = SpreadOf(center_priors, model);
  for (int round = 0; round < kMaxNumRounds; ++round) {
    // Where the model is bent, positions are off without being wrong.
    center_priors.loss_scale = options.loss_scale * std::max(1.0, spread);
    if (!PositionCameras(context.options.refinement.global_positioning,
                         context.verification.num_threads,
                         fixed_image,
                         &model,
                         progress->rigs.frames,
                         center_priors)
             .success) {
      LOG(WARNING) << "Positioning with the positions of the images failed";
      break;
    }
    const double last_spread = spread;
    spread = SpreadOf(center_priors, model);
    if (spread > kMinShrinkage * last_spread) break;
  }
  const double factor = StddevFactor(priors, spread);
  progress->center_priors = CenterPriorsOf(options, priors, factor, model);
  timer.Add("images", double(center_priors.centers.size()))
      .Add("inliers", double(alignment->num_inliers))
      .Add("spread", spread)
      .Add("stddev_factor", factor);
  timer.Finish(&log->stages);
}

ModelGeoreference FinishFrame(const MappingContext& context,
                              ModelInProgress* progress,
                              MeasuredUnit* unit,
                              MappingLog* log) {
  ModelGeoreference result;
  const GeoreferencingOptions& options = context.options.georeferencing;
  const PosePriors& priors = context.scene.pose_priors;
  colmap::Reconstruction& model = progress->model;
  const bool is_by_rigs = progress->rigs.fix_scale;
  if (progress->positions_from_start) {
    // What the positions leave open, such as the turn about a line that they
    // are on, is as the cameras are held.
    const auto alignment =
        AlignToPositions(options, priors, ScaleByRigs(*progress), model);
    if (alignment) {
      TransformModel(alignment->target_from_source, &model);
      result.SetAlignment(*alignment);
    }
    result.scale_source =
        is_by_rigs ? ScaleSource::RIGS : ScaleSource::POSITIONS;
    const auto free = AlignToPositions(options, priors, std::nullopt, model);
    if (free && is_by_rigs) {
      result.scale_of_rigs = 1 / free->target_from_source.scale;
      result.log_scale_stddev_of_positions = free->log_scale_stddev;
    }
    if (const auto depth = MeasureDepthScale(context.depths, model)) {
      result.scale_of_depth = 1 / depth->scale;
      result.log_scale_stddev_of_depth = depth->log_stddev;
    }
    result.is_georeferenced = options.georeference;
    result.SetErrors(priors, model);
    if (!options.georeference) {
      TransformModel(progress->positions_from_start->Inverse(), &model);
      if (!is_by_rigs) *unit = NormalizeToDepth(context.depths, &model);
    }
  } else {
    if (!is_by_rigs) *unit = NormalizeToDepth(context.depths, &model);
    if (options.use_positions && HasPositions(priors) &&
        model.NumRegImages() > 0) {
      PlaceByPositions(context, progress, &result, log);
      if (result.is_georeferenced) result.SetErrors(priors, model);
    }
  }
  if (!result.is_georeferenced && options.upright) {
    StandUpright(context, &model);
  }
  return result;
}

}  // namespace dgsfm
