#include "sfm/global_mapping.h"

#include "colmap_ext/check.h"
#include "sfm/georeferencing/model_joining.h"
#include "sfm/georeferencing/pair_positions.h"
#include "sfm/intrinsics/calibration_check.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/view_graph/pair_recovery.h"
#include "sfm/view_graph/sensor_check.h"
#include "sfm/view_graph/view_graph_preparation.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <numeric>
#include <set>
#include <sstream>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Factor between metric depth and the baselines of rigs from which one of them
// has another unit.
constexpr double kMaxRigDepthRatio = 10;
constexpr const char* kNotConnected = "not connected to the largest model";

void SetReason(const ImageIds& image_ids,
               const std::string& reason,
               std::map<colmap::image_t, std::string>* reasons) {
  for (const colmap::image_t image_id : image_ids) {
    (*reasons)[image_id] = reason;
  }
}

std::optional<ComponentRotations> AverageRotationsOf(
    const MappingContext& context,
    const ImageIds& image_ids,
    PairGeometries* pairs,
    MappingLog* log) {
  StageTimer timer("rotation_averaging");
  timer.Add("images", double(image_ids.size()));
  std::optional<ComponentRotations> rotations =
      AverageComponentRotations(context.options.averaging,
                                context.scene,
                                context.frames,
                                image_ids,
                                context.verification.num_threads,
                                pairs);
  if (!rotations) {
    LOG(ERROR) << "Rotation averaging failed for the component of image "
               << image_ids.front();
    return std::nullopt;
  }
  timer.Add("pairs_filtered", double(rotations->num_pairs_filtered))
      .Add("images_kept", double(rotations->image_ids.size()));
  if (rotations->num_gravities > 0) {
    timer.Add("images_with_gravity", double(rotations->num_gravities));
  }
  timer.Finish(&log->stages);
  return rotations;
}

void AddComponent(const RigScene& rigs,
                  ComponentResult component,
                  DepthGlobalMapperResult* result) {
  if (component.model) {
    result->rigs.push_back(
        CalibrateRigs(component.refined_sensors, *component.model, rigs));
    result->models.push_back(std::move(component.model));
    result->georeferences.push_back(component.georeference);
  }
  if (component.repeatability) result->repeatability = component.repeatability;
  result->cameras.merge(component.cameras);
  result->depth_scales.merge(component.depth_scales);
  for (const auto& [image_id, reason] : component.unregistered_images) {
    result->unregistered_images[image_id] = reason;
  }
}

// An id beyond those of all cameras, and of those that images get of their own.
colmap::camera_t FirstUnusedCameraId(const Scene& scene) {
  colmap::camera_t first = 0;
  if (!scene.cameras.empty()) first += scene.cameras.rbegin()->first + 1;
  if (!scene.images.empty()) first += scene.images.rbegin()->first + 1;
  return first;
}

MappedComponent MapImages(const MappingContext& context,
                          const ImageIds& image_ids,
                          bool measure_repeatability,
                          PairGeometries* pairs,
                          MappingLog* log) {
  const size_t num_stages = log->stages.size();
  const size_t num_warnings = log->warnings.size();
  MappedComponent mapped;
  const std::optional<ComponentRotations> rotations =
      AverageRotationsOf(context, image_ids, pairs, log);
  if (rotations) {
    mapped.other_parts = rotations->other_parts;
    RecoverPairs(context, *rotations, pairs, log);
    mapped.result =
        MapComponent(context, *rotations, measure_repeatability, pairs, log);
  } else {
    SetReason(image_ids,
              "rotation averaging failed",
              &mapped.result.unregistered_images);
  }
  mapped.pairs = OutcomesOf(image_ids, *pairs);
  mapped.log.stages.assign(log->stages.begin() + num_stages, log->stages.end());
  mapped.log.warnings.assign(log->warnings.begin() + num_warnings,
                             log->warnings.end());
  return mapped;
}

// As MapImages(), but from the store, if there is one, where it has the
// component.
MappedComponent MapOrFind(const MappingContext& context,
                          const ImageIds& image_ids,
                          bool measure_repeatability,
                          ComponentStore* store,
                          PairGeometries* pairs,
                          MappingLog* log) {
  std::optional<MappedComponent> found;
  if (store) found = store->Find(image_ids);
  if (!found) {
    MappedComponent mapped =
        MapImages(context, image_ids, measure_repeatability, pairs, log);
    if (store) store->Keep(image_ids, mapped);
    return mapped;
  }
  LOG(INFO) << "The " << image_ids.size() << " images from "
            << context.scene.images.at(image_ids.front()).Name()
            << " on were mapped by the run that was broken off";
  ApplyOutcomes(found->pairs, pairs);
  log->stages.insert(
      log->stages.end(), found->log.stages.begin(), found->log.stages.end());
  for (const std::string& warning : found->log.warnings) log->Warn(warning);
  return std::move(*found);
}

// Maps component after component; parts that rotation averaging cuts off are
// components of their own.
void MapComponents(const MappingContext& context,
                   ComponentStore* store,
                   PairGeometries* pairs,
                   DepthGlobalMapperResult* result,
                   MappingLog* log) {
  const DepthGlobalMapperOptions& options = context.options;
  std::vector<ImageIds> components = ConnectedImages(*pairs, context.frames);
  for (size_t i = 0; i < components.size(); ++i) {
    // A copy: parts that are cut off are appended below, which moves the list.
    const ImageIds image_ids = components[i];
    if (image_ids.size() < MinModelSize(context)) {
      SetReason(image_ids,
                "connected to only " + std::to_string(image_ids.size() - 1) +
                    " other images",
                &result->unregistered_images);
      continue;
    }
    if (i > 0 && !options.multiple_models) {
      SetReason(image_ids, kNotConnected, &result->unregistered_images);
      continue;
    }
    const bool measure_repeatability =
        options.measure_repeatability && !result->repeatability;
    MappedComponent mapped =
        MapOrFind(context, image_ids, measure_repeatability, store, pairs, log);
    for (const ImageIds& part : mapped.other_parts) {
      if (options.multiple_models) {
        components.push_back(part);
      } else {
        SetReason(part, kNotConnected, &result->unregistered_images);
      }
    }
    AddComponent(context.scene.rigs, std::move(mapped.result), result);
  }
}

// One model of those that share the frame of the positions, and the largest
// first.
void ArrangeModels(const MappingContext& context,
                   DepthGlobalMapperResult* result,
                   MappingLog* log) {
  auto& models = result->models;
  if (context.options.georeferencing.join_models) {
    const size_t num_models = models.size();
    JoinGeoreferencedModels(FirstUnusedCameraId(context.scene),
                            &models,
                            &result->georeferences,
                            &result->rigs);
    if (models.size() < num_models) {
      log->Warn(std::to_string(num_models - models.size() + 1) +
                " parts that no match connects are one model in the frame of "
                "the positions of their images, as accurate to each other as "
                "these (--join_models 0 keeps them apart)");
    }
  }
  std::vector<size_t> order(models.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](size_t i, size_t j) {
    return models[i]->NumRegImages() > models[j]->NumRegImages();
  });
  std::vector<std::unique_ptr<colmap::Reconstruction>> sorted;
  std::vector<ModelGeoreference> georeferences;
  std::vector<RigScene> rigs;
  for (const size_t i : order) {
    sorted.push_back(std::move(models[i]));
    georeferences.push_back(std::move(result->georeferences[i]));
    rigs.push_back(std::move(result->rigs[i]));
  }
  models = std::move(sorted);
  result->georeferences = std::move(georeferences);
  result->rigs = std::move(rigs);
}

// Reversed or wrongly scaled baselines of rigs fit the matches of a model whose
// frames are hardly apart.
void WarnOfRigScale(const MeasuredUnit& unit,
                    size_t num_images,
                    MappingLog* log) {
  if (std::abs(unit.log_scale) < std::log(kMaxRigDepthRatio)) return;
  std::ostringstream factor;
  factor << std::setprecision(3) << std::exp(std::abs(unit.log_scale));
  log->Warn("The metric depth maps of a model with " +
            std::to_string(num_images) +
            " images differ from the baselines of its rigs by a factor of " +
            factor.str() +
            ": check that the poses of the sensors are in metres and map from "
            "the rig to the camera, not back, have them estimated "
            "(--DepthGlobalMapper.refine_sensor_from_rig 1), or leave the rigs "
            "out (--ignore_rigs 1)");
}

void MeasureUnits(const MappingContext& context,
                  DepthGlobalMapperResult* result,
                  MappingLog* log) {
  for (size_t i = 0; i < result->models.size(); ++i) {
    const auto& model = result->models[i];
    MeasuredUnit unit =
        UnitOfModel(context.depths, result->depth_scales, *model);
    const bool rigs_fix_scale =
        !context.options.refine_sensor_from_rig &&
        HasBaseline(context.frames, model->RegImageIds());
    const bool is_georeferenced = result->georeferences[i].is_georeferenced;
    if (rigs_fix_scale) {
      if (unit.is_metric) WarnOfRigScale(unit, model->NumRegImages(), log);
      unit.unit = ModelUnit::RIGS;
    }
    if (is_georeferenced) unit.unit = ModelUnit::METRES;
    result->units.push_back(unit);
    if (rigs_fix_scale || is_georeferenced || !unit.is_metric ||
        !unit.IsDoubtful()) {
      continue;
    }
    std::ostringstream factor;
    factor << std::setprecision(2) << std::exp(unit.log_spread);
    log->Warn("The scales of the depth maps of a model with " +
              std::to_string(model->NumRegImages()) +
              " images differ by a factor of " + factor.str() +
              " (one standard deviation): its unit is not metres. Check that "
              "the maps are metric and belong to the images, or give positions "
              "of the images (--pose_priors_path)");
  }
}

// The reason why an image is in no component.
std::string WhyWithoutPairs(const colmap::Image& image,
                            const std::map<PairStatus, size_t>& statuses) {
  if (image.NumPoints2D() == 0) return "no key points";
  if (statuses.empty()) return "no matches with other images";
  std::string reason = "no valid pair:";
  for (const auto& [status, count] : statuses) {
    reason += " " + std::to_string(count) + " " + PairStatusName(status);
  }
  return reason;
}

void ExplainMissingImages(const Scene& scene,
                          const PairGeometries& pairs,
                          DepthGlobalMapperResult* result) {
  std::map<colmap::image_t, std::map<PairStatus, size_t>> statuses;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    ++statuses[image_id1][pair.status];
    ++statuses[image_id2][pair.status];
  }
  std::set<colmap::image_t> registered;
  for (const auto& model : result->models) {
    registered.insert(model->RegImageIds().begin(), model->RegImageIds().end());
  }
  for (const auto& [image_id, image] : scene.images) {
    if (registered.count(image_id) > 0) {
      result->unregistered_images.erase(image_id);
    } else if (result->unregistered_images.count(image_id) == 0) {
      result->unregistered_images[image_id] =
          WhyWithoutPairs(image, statuses[image_id]);
    }
  }
}

}  // namespace

DepthGlobalMapperResult RunGlobalMapping(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const PairScores& pair_scores,
    Scene* scene,
    KeypointDepthMap* depths,
    PairGeometries* pairs,
    ComponentStore* store) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(verification.IsValid(&error)) << error;

  DepthGlobalMapperResult result;
  MappingLog log;
  const CameraBeliefs camera_beliefs = GivenBeliefs(*scene);
  for (const std::string& advice : PrincipalPointAdvice(scene->cameras)) {
    log.Warn(advice);
  }
  DropStaticBackground(options, verification, *depths, scene, pairs, &log);
  result.dropped_depths =
      DropUnreliableDepths(options, verification, *scene, depths, pairs, &log);
  FilterPairs(options, *scene, pair_scores, pairs, &log);
  JudgePairsByPosition(options.georeferencing, scene->pose_priors, pairs, &log);
  result.focals =
      AverageFocals(options, verification, *depths, scene, pairs, &log);
  WarnOfPlanes(*scene, *pairs, &log);
  DropContradictedSensors(*pairs, scene, &log);
  const FrameMembers frames = MembersOf(scene->rigs);
  const MappingContext context = {
      options, verification, *scene, *depths, frames, camera_beliefs};
  MapComponents(context, store, pairs, &result, &log);
  ArrangeModels(context, &result, &log);
  MeasureUnits(context, &result, &log);
  ExplainMissingImages(*scene, *pairs, &result);
  result.stages = std::move(log.stages);
  result.warnings = std::move(log.warnings);
  return result;
}

}  // namespace dgsfm
