#include "sfm/depth_global_mapper.h"

#include "colmap_ext/check.h"
#include "colmap_ext/pose_access.h"
#include "estimators/option_check.h"
#include "sfm/camera_model_check.h"
#include "sfm/depth_reliability.h"
#include "sfm/model_access.h"
#include "sfm/static_background.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <set>
#include <sstream>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Share of observations whose removal is worth another round of adjustment.
constexpr double kMinFilteredShare = 1e-3;
// Relative decrease by an iteration that ends adjustments before the model is
// complete.
constexpr double kPreliminaryFunctionTolerance = 1e-4;
// Depth maps are not better than this [log].
constexpr double kMinDepthStddev = 0.01;
// Share of maps that contradict their pairs beyond which something common to
// all is wrong.
constexpr double kMaxUnreliableShare = 0.3;
// Rounds of retriangulation and adjustment.
constexpr int kMaxNumRetriangulationRounds = 2;

// Registered image with the most points, of these the one with the smallest
// id: the best anchor of the gauge.
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

// Of an image whose pairs give it a rotation but no position.
std::string WhyNotPositioned(colmap::image_t image_id,
                             const PairGeometries& pairs) {
  size_t num_valid = 0, num_rotation_only = 0;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (pair.status != PairStatus::VALID ||
        (image_id1 != image_id && image_id2 != image_id)) {
      continue;
    }
    ++num_valid;
    num_rotation_only += pair.Has(PairDegeneracy::ROTATION_ONLY);
  }
  if (2 * num_rotation_only <= num_valid) {
    return "sees too few tracks to be positioned";
  }
  return std::to_string(num_rotation_only) + " of its " +
         std::to_string(num_valid) +
         " valid pairs show a rotation only: a position needs images from "
         "other places, or depth";
}

// The inliers of the valid pairs between registered images.
void AddInliers(const PairGeometries& pairs,
                const colmap::Reconstruction& model,
                colmap::CorrespondenceGraph* graph) {
  for (const auto& [image_id, image] : model.Images()) {
    graph->AddImage(image_id, image.NumPoints2D());
  }
  const auto is_registered = [&](colmap::image_t image_id) {
    return model.ExistsImage(image_id) && model.IsImageRegistered(image_id);
  };
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (pair.status == PairStatus::VALID && is_registered(image_id1) &&
        is_registered(image_id2)) {
      graph->AddCorrespondences(image_id1, image_id2, pair.inlier_matches);
    }
  }
}

// Whether the focal lengths of a pair may be far off: without depth, or where
// its matches do not tell them. The others gain nothing from averaged ones.
bool LacksFocals(const PairGeometry& pair) {
  return !pair.has_scale || pair.Has(PairDegeneracy::WEAK_FOCAL1) ||
         pair.Has(PairDegeneracy::WEAK_FOCAL2);
}

}  // namespace

bool DepthGlobalMapperOptions::IsValid(std::string* error) const {
  if (!view_graph.IsValid(error) || !view_graph_calibration.IsValid(error) ||
      !averaging.IsValid(error) || !tracks.IsValid(error) ||
      !refinement.IsValid(error) || !camera_grouping.IsValid(error)) {
    return false;
  }
  return CheckOption(min_model_size >= 2,
                     "min_model_size must be >= 2",
                     min_model_size,
                     error);
}

DepthGlobalMapper::DepthGlobalMapper(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const Scene& scene,
    KeypointDepthMap depths,
    const PairScores& pair_scores)
    : options_(options),
      verification_(verification),
      scene_(scene),
      beliefs_(GivenBeliefs(scene)),
      depths_(std::move(depths)),
      pair_scores_(pair_scores) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(verification.IsValid(&error)) << error;
  options_.refinement.num_threads = options_.num_threads;
  options_.position_initialization.random_seed = verification.random_seed;
  verification_.num_threads = options_.num_threads;
}

DepthGlobalMapperResult DepthGlobalMapper::Run(PairGeometries* pairs) {
  if (!options_.skip_static_background) DropStaticBackground(pairs);
  if (!options_.skip_depth_reliability) DropUnreliableDepths(pairs);
  FilterPairs(pairs);
  CalibrateAndReverify(pairs);
  WarnOfPlanes(*pairs);
  std::vector<ImageIds> components = ConnectedImages(*pairs);
  if (!options_.multiple_models && components.size() > 1) components.resize(1);
  for (size_t i = 0; i < components.size(); ++i) {
    const ImageIds image_ids = components[i];
    if (image_ids.size() < size_t(options_.min_model_size)) {
      for (const colmap::image_t image_id : image_ids) {
        result_.unregistered_images[image_id] =
            "connected to only " + std::to_string(image_ids.size() - 1) +
            " other images";
      }
      continue;
    }
    const std::optional<ComponentRotations> rotations =
        AverageRotationsOf(image_ids, pairs);
    if (!rotations) continue;
    if (options_.multiple_models) {
      components.insert(components.end(),
                        rotations->other_parts.begin(),
                        rotations->other_parts.end());
    } else {
      for (const ImageIds& part : rotations->other_parts) {
        for (const colmap::image_t image_id : part) {
          result_.unregistered_images[image_id] =
              "not connected to the largest model";
        }
      }
    }
    std::unique_ptr<colmap::Reconstruction> model = MapComponent(
        pairs, ImageIndex(rotations->image_ids), rotations->cam_from_world);
    if (model) result_.models.push_back(std::move(model));
  }
  std::stable_sort(result_.models.begin(),
                   result_.models.end(),
                   [](const auto& a, const auto& b) {
                     return a->NumRegImages() > b->NumRegImages();
                   });
  MeasureUnits();
  ExplainMissingImages(*pairs);
  return std::move(result_);
}

void DepthGlobalMapper::DropStaticBackground(PairGeometries* pairs) {
  // Key points are found within about this many thresholds of matches.
  constexpr double kMaxMotion = 3;
  const std::vector<StaticKeypoints> groups = FindStaticKeypoints(
      scene_,
      *pairs,
      kMaxMotion * verification_.two_view.max_epipolar_error_px);
  if (groups.empty()) return;
  StageTimer timer("static_background");
  const size_t num_stationary =
      CountPairs(*pairs).num_with_status[PairStatus::STATIONARY];
  size_t num_groups = 0;
  for (const StaticKeypoints& keypoints : groups) {
    auto matches = MatchesThatMove(scene_, keypoints);
    PairGeometries moving =
        VerifyPairs(scene_, matches, depths_, verification_);
    PairGeometries replaced;
    for (const auto& [pair_id, pair] : moving) {
      replaced[pair_id] = pairs->at(pair_id);
    }
    if (CountMovingPairs(moving) <= CountMovingPairs(replaced)) continue;
    ++num_groups;
    for (auto& [pair_id, pair] : moving) {
      scene_.matches[pair_id] = std::move(matches.at(pair_id));
      pairs->at(pair_id) = std::move(pair);
    }
  }
  timer.Add("groups", double(num_groups)).Add(CountPairs(*pairs));
  timer.Finish(&result_.stages);
  if (num_groups > 0) {
    Warn(std::to_string(num_stationary) + " of " +
         std::to_string(pairs->size()) +
         " pairs are stationary: most of their key points stay at their place, "
         "as those of a background behind a turntable, and are left out. Mask "
         "the background to be safe (--ImageReader.mask_path)");
  }
}

void DepthGlobalMapper::DropUnreliableDepths(PairGeometries* pairs) {
  StageTimer timer("depth_reliability");
  const std::vector<colmap::image_t> image_ids = FindUnreliableDepths(*pairs);
  for (const colmap::image_t image_id : image_ids) {
    LOG(WARNING) << "The depth map of image '"
                 << scene_.images.at(image_id).Name()
                 << "' contradicts its matches and is not used";
    depths_.erase(image_id);
  }
  if (double(image_ids.size()) >
      kMaxUnreliableShare * double(image_ids.size() + depths_.size())) {
    Warn(std::to_string(image_ids.size()) +
         " depth maps contradict the matches and are not used: check that they "
         "belong to the images (orientation, cropping), and that the camera "
         "model fits the lens");
  }
  const auto is_unreliable = [&](colmap::image_t image_id) {
    return std::binary_search(image_ids.begin(), image_ids.end(), image_id);
  };
  std::vector<colmap::image_pair_t> affected;
  for (const auto& [pair_id, matches] : scene_.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (is_unreliable(image_id1) || is_unreliable(image_id2)) {
      affected.push_back(pair_id);
    }
  }
  VerifyAgain(affected, pairs);
  timer.Add("maps_dropped", double(image_ids.size()))
      .Add("pairs_verified", double(affected.size()));
  if (!image_ids.empty()) timer.Add(CountPairs(*pairs));
  timer.Finish(&result_.stages);
}

void DepthGlobalMapper::VerifyAgain(
    const std::vector<colmap::image_pair_t>& pair_ids,
    PairGeometries* pairs) const {
  if (pair_ids.empty()) return;
  std::map<colmap::image_pair_t, colmap::FeatureMatches> matches;
  for (const colmap::image_pair_t pair_id : pair_ids) {
    matches[pair_id] = scene_.matches.at(pair_id);
  }
  for (auto& [pair_id, pair] :
       VerifyPairs(scene_, matches, depths_, verification_)) {
    pairs->at(pair_id) = std::move(pair);
  }
}

void DepthGlobalMapper::FilterPairs(PairGeometries* pairs) {
  StageTimer timer("view_graph_filter");
  if (!options_.skip_pair_scores) {
    FilterByPairScore(pair_scores_, options_.view_graph, pairs);
  }
  if (options_.view_graph.min_triplet_support > 0) {
    FilterByTripletSupport(options_.view_graph, pairs);
  }
  timer.Add(CountPairs(*pairs));
  timer.Finish(&result_.stages);
}

void DepthGlobalMapper::CalibrateAndReverify(PairGeometries* pairs) {
  if (options_.skip_focal_averaging) return;
  StageTimer timer("focal_averaging");
  result_.focals = AverageFocalsOfCameras(
      *pairs, depths_, options_.view_graph_calibration, TiesCameras(), &scene_);
  std::map<FocalSource, size_t> num_cameras;
  for (const auto& [camera_id, focal] : result_.focals) {
    ++num_cameras[focal.source];
  }
  for (const auto& [source, count] : num_cameras) {
    timer.Add(FocalSourceName(source), double(count));
  }
  timer.Finish(&result_.stages);

  if (options_.skip_reverification ||
      num_cameras[FocalSource::PRIOR] == result_.focals.size()) {
    return;
  }
  StageTimer reverification("reverification");
  const CameraMap averaged_cameras = scene_.cameras;
  for (auto& [camera_id, camera] : scene_.cameras) {
    camera.SetPriorFocalLength(true);
  }
  std::vector<colmap::image_pair_t> uncertain;
  for (const auto& [pair_id, pair] : *pairs) {
    if (pair.status == PairStatus::VALID && LacksFocals(pair)) {
      uncertain.push_back(pair_id);
    }
  }
  VerifyAgain(uncertain, pairs);
  scene_.cameras = averaged_cameras;
  reverification.Add("pairs_verified", double(uncertain.size()))
      .Add(CountPairs(*pairs));
  reverification.Finish(&result_.stages);
}

std::optional<ComponentRotations> DepthGlobalMapper::AverageRotationsOf(
    const ImageIds& image_ids, PairGeometries* pairs) {
  StageTimer timer("rotation_averaging");
  timer.Add("images", double(image_ids.size()));
  std::optional<ComponentRotations> rotations = AverageComponentRotations(
      options_.averaging, scene_, depths_, image_ids, pairs);
  if (!rotations) {
    LOG(ERROR) << "Rotation averaging failed for the component of image "
               << image_ids.front();
    for (const colmap::image_t image_id : image_ids) {
      result_.unregistered_images[image_id] = "rotation averaging failed";
    }
    return std::nullopt;
  }
  timer.Add("pairs_filtered", double(rotations->num_pairs_filtered))
      .Add("images_kept", double(rotations->image_ids.size()));
  timer.Finish(&result_.stages);
  return rotations;
}

ImageScales DepthGlobalMapper::AverageScalesOf(const ImageIndex& index,
                                               PairGeometries* pairs) {
  StageTimer timer("scale_averaging");
  const ComponentScales scales = AverageComponentScales(
      options_.averaging, options_.skip_scale_averaging, index, pairs);
  timer.Add("pairs", double(scales.num_pairs))
      .Add("outliers", double(scales.num_outliers))
      .Add("images", double(scales.scales.size()));
  timer.Finish(&result_.stages);
  return scales.scales;
}

std::unique_ptr<colmap::Reconstruction> DepthGlobalMapper::CreateModel(
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations) const {
  auto model = std::make_unique<colmap::Reconstruction>();
  for (int i = 0; i < index.Size(); ++i) {
    colmap::Image image = scene_.images.at(index.IdOf(i));
    if (!model->ExistsCamera(image.CameraId())) {
      model->AddCamera(scene_.cameras.at(image.CameraId()));
    }
    SetCamFromWorld({cam_from_world_rotations[i], Eigen::Vector3d::Zero()},
                    &image);
    model->AddImage(image);
  }
  return model;
}

std::unique_ptr<colmap::Reconstruction> DepthGlobalMapper::MapComponent(
    PairGeometries* pairs,
    const ImageIndex& index,
    const std::vector<Eigen::Quaterniond>& cam_from_world_rotations) {
  const ImageScales scales = AverageScalesOf(index, pairs);
  ImageCenters centers;
  if (!options_.skip_translation_averaging) {
    StageTimer timer("translation_averaging");
    const ComponentTranslations translations = AverageComponentTranslations(
        options_.averaging, index, cam_from_world_rotations, scales, pairs);
    centers = translations.centers;
    timer.Add("pairs_filtered", double(translations.num_pairs_filtered));
    timer.Finish(&result_.stages);
  }
  std::unique_ptr<colmap::Reconstruction> model =
      CreateModel(index, cam_from_world_rotations);

  StageTimer initialization("initialization");
  const std::vector<colmap::Track> tracks =
      EstablishTracks(index, *pairs, options_.tracks);
  InitializePositions(index,
                      *pairs,
                      depths_,
                      scales,
                      centers,
                      tracks,
                      options_.position_initialization,
                      model.get());
  initialization.Add("tracks", double(tracks.size()))
      .Add("images", double(model->NumRegImages()))
      .Add("points", double(model->NumPoints3D()));
  initialization.Finish(&result_.stages);
  const ImageCenters start_centers = CentersOf(*model);
  depth_priors_ = {&depths_, {}};
  for (const auto& [image_id, scale] : DepthScalesOfModel(depths_, *model)) {
    depth_priors_.stddevs[image_id] =
        std::max(scale.log_spread, kMinDepthStddev);
  }
  for (int i = 0; i < index.Size(); ++i) {
    if (!model->IsImageRegistered(index.IdOf(i))) {
      result_.unregistered_images[index.IdOf(i)] =
          WhyNotPositioned(index.IdOf(i), *pairs);
    }
  }

  CameraBeliefs beliefs = beliefs_;
  final_loss_scale_px_ = options_.refinement.bundle_adjustment.loss_scale_px;
  const bool success = RefineModel(&beliefs, model.get());
  if (success) CompleteModel(&beliefs, pairs, model.get());
  FinishModel(start_centers, model.get());
  if (!success || model->NumRegImages() < size_t(options_.min_model_size)) {
    for (const colmap::image_t image_id : model->RegImageIds()) {
      result_.unregistered_images[image_id] =
          success ? "its model has fewer than " +
                        std::to_string(options_.min_model_size) + " images"
                  : "the optimisation of its model failed";
      result_.depth_scales.erase(image_id);
    }
    return nullptr;
  }
  KeepGroupsOf(*model, &beliefs.groups);
  std::map<colmap::camera_t, colmap::camera_t> final_ids =
      options_.share_intrinsics
          ? FirstOfRigidGroups(beliefs.groups)
          : JoinedCameraIds(camera_origins_, beliefs.groups, *model);
  for (auto& [camera_id, result] :
       SummarizeCameras(FinalAdjustment(), beliefs, *model)) {
    const auto final_id = final_ids.find(camera_id);
    result_.cameras.emplace(
        final_id == final_ids.end() ? camera_id : final_id->second, result);
  }
  const bool are_new =
      std::any_of(final_ids.begin(), final_ids.end(), [](const auto& ids) {
        return ids.first != ids.second;
      });
  if (are_new) RenameCameras(final_ids, model.get());
  return model;
}

bool DepthGlobalMapper::TiesCameras() const {
  return !options_.skip_self_calibration && !options_.skip_camera_ties;
}

bool DepthGlobalMapper::HasFinalAdjustment() const {
  return !options_.skip_self_calibration || !options_.skip_loss_adaptation ||
         !options_.skip_retriangulation;
}

void DepthGlobalMapper::CompleteModel(CameraBeliefs* beliefs,
                                      PairGeometries* pairs,
                                      colmap::Reconstruction* model) {
  if (!options_.skip_loss_adaptation) {
    final_loss_scale_px_ =
        AdaptedLossScale(options_.refinement.bundle_adjustment, *model);
  }
  if (!options_.skip_self_calibration) CalibrateCameras(beliefs, model);
  if (!options_.skip_retriangulation) {
    RetriangulateModel(*beliefs, *pairs, model);
  } else if (HasFinalAdjustment()) {
    StageTimer timer("final_adjustment");
    AdjustAgain(*beliefs, model, &timer);
    timer.Finish(&result_.stages);
  }
  if (!options_.skip_pair_judging) JudgePairsByModel(*model, pairs);
  if (options_.measure_repeatability && !result_.repeatability) {
    MeasureRepeatability(*beliefs, *model);
  }
  if (HasFinalAdjustment()) HoldImplausibleCameras(beliefs, model);
}

bool DepthGlobalMapper::RefineModel(CameraBeliefs* beliefs,
                                    colmap::Reconstruction* model) {
  if (!TiesCameras()) {
    return PositionModel(model) && AdjustModel(*beliefs, model);
  }
  // Few images may leave a group at once: the others say what is wrong.
  constexpr int kMaxNumTrials = 3;
  const colmap::Reconstruction start = *model;
  const IntrinsicsPriorOptions& prior =
      options_.refinement.bundle_adjustment.intrinsics;
  TieCameraClasses(prior, beliefs, model);
  for (int trial = 1;; ++trial) {
    if (!PositionModel(model) || !AdjustModel(*beliefs, model)) return false;
    if (trial == kMaxNumTrials) return true;
    const ImageIds image_ids =
        FindContradictingImages(SelfCalibration(), *beliefs, *model);
    if (image_ids.empty() || !Untie(image_ids, beliefs)) return true;
    *model = start;
    UseCamerasOf(scene_, model);
  }
}

bool DepthGlobalMapper::Untie(const ImageIds& image_ids,
                              CameraBeliefs* beliefs) {
  const size_t num_tied = beliefs->NumTiedCameras();
  const size_t num_split = camera_origins_.size();
  if (options_.split_cameras) {
    const std::set<colmap::camera_t> shared = SharedCameras(scene_);
    std::set<colmap::camera_t> contradicted;
    for (const colmap::image_t image_id : image_ids) {
      const colmap::camera_t camera_id = scene_.images.at(image_id).CameraId();
      if (shared.count(camera_id) > 0) contradicted.insert(camera_id);
    }
    SplitSharedCameras(contradicted);
    AddSplitCameras(camera_origins_, beliefs);
  }
  UntieImages(scene_, camera_origins_, image_ids, &beliefs->groups);
  return camera_origins_.size() != num_split ||
         beliefs->NumTiedCameras() != num_tied;
}

void DepthGlobalMapper::SplitSharedCameras(
    const std::set<colmap::camera_t>& camera_ids) {
  for (const colmap::camera_t camera_id : camera_ids) {
    Warn("The images of camera " + std::to_string(camera_id) +
         " have focal lengths that differ by more than their errors: each gets "
         "a camera of its own where it differs (--split_cameras 0 keeps one)");
  }
  SplitCameras(camera_ids, &scene_, &camera_origins_);
  AddSplitCameras(camera_origins_, &beliefs_);
}

bool DepthGlobalMapper::PositionModel(colmap::Reconstruction* model) {
  if (model->NumPoints3D() == 0) return false;
  if (options_.skip_global_positioning) return true;
  StageTimer timer("global_positioning");
  const GlobalPositioningSummary summary = PositionCameras(
      options_.refinement, depth_priors_, AnchorImage(*model), model);
  if (!summary.success) {
    LOG(ERROR) << "Global positioning failed: " << summary.message;
    return false;
  }
  const size_t num_filtered = FilterObservationsByAngle(
      options_.refinement.max_angular_error_deg, model);
  timer.Add("iterations", summary.num_iterations)
      .Add("converged", summary.converged)
      .Add("initial_cost", summary.initial_cost)
      .Add("final_cost", summary.final_cost)
      .Add("observations_filtered", double(num_filtered))
      .Add("points", double(model->NumPoints3D()));
  timer.Finish(&result_.stages);
  return model->NumPoints3D() > 0;
}

bool DepthGlobalMapper::AdjustModel(const CameraBeliefs& beliefs,
                                    colmap::Reconstruction* model) {
  if (options_.skip_bundle_adjustment) return true;
  const int num_rounds = options_.refinement.num_bundle_adjustment_rounds;
  BundleAdjustmentOptions adjustment = options_.refinement.bundle_adjustment;
  if (HasFinalAdjustment()) {
    adjustment.function_tolerance =
        std::max(adjustment.function_tolerance, kPreliminaryFunctionTolerance);
  }
  for (int round = 0; round < num_rounds; ++round) {
    StageTimer timer("bundle_adjustment");
    const std::optional<double> rms =
        AdjustBundle(adjustment,
                     options_.num_threads,
                     AnchorImage(*model),
                     beliefs,
                     PriorsInNeed(options_.refinement, *model, depth_priors_),
                     model);
    if (!rms) return false;
    const size_t num_filtered =
        FilterObservations(options_.refinement, num_rounds - round, model);
    timer.Add("round", round + 1)
        .Add("rms_px", *rms)
        .Add("observations_filtered", double(num_filtered))
        .Add("points", double(model->NumPoints3D()));
    timer.Finish(&result_.stages);
  }
  return model->NumPoints3D() > 0;
}

std::unique_ptr<colmap::CorrespondenceGraph>
DepthGlobalMapper::CandidateMatches(const PairGeometries& pairs,
                                    const colmap::Reconstruction& model) const {
  auto graph = std::make_unique<colmap::CorrespondenceGraph>();
  if (options_.skip_match_completion) {
    AddInliers(pairs, model, graph.get());
  } else {
    BuildCorrespondenceGraph(scene_,
                             pairs,
                             verification_,
                             options_.refinement.max_epipolar_error_px,
                             model,
                             graph.get());
  }
  return graph;
}

size_t DepthGlobalMapper::AdjustAgain(const CameraBeliefs& beliefs,
                                      colmap::Reconstruction* model,
                                      StageTimer* timer) {
  const std::optional<double> rms =
      AdjustBundle(FinalAdjustment(),
                   options_.num_threads,
                   AnchorImage(*model),
                   beliefs,
                   PriorsInNeed(options_.refinement, *model, depth_priors_),
                   model);
  const size_t num_filtered =
      FilterObservations(options_.refinement, 1.0, model);
  if (rms) {
    timer->Add("rms_px", *rms);
  } else {
    LOG(WARNING) << "The final bundle adjustment failed";
    timer->Add("adjustment_failed", 1);
  }
  timer->Add("observations_filtered", double(num_filtered))
      .Add("points", double(model->NumPoints3D()));
  return num_filtered;
}

void DepthGlobalMapper::RetriangulateModel(const CameraBeliefs& beliefs,
                                           const PairGeometries& pairs,
                                           colmap::Reconstruction* model) {
  for (int round = 0; round < kMaxNumRetriangulationRounds; ++round) {
    StageTimer timer("retriangulation");
    const size_t num_gained = Retriangulate(
        options_.refinement, *CandidateMatches(pairs, *model), model);
    timer.Add("observations_gained", double(num_gained));
    const size_t num_filtered = AdjustAgain(beliefs, model, &timer);
    timer.Finish(&result_.stages);
    const double num_observations = double(model->ComputeNumObservations());
    if (double(num_gained + num_filtered) <
        kMinFilteredShare * num_observations) {
      break;
    }
  }
}

void DepthGlobalMapper::MeasureRepeatability(
    const CameraBeliefs& beliefs, const colmap::Reconstruction& model) {
  StageTimer timer("repeatability");
  result_.repeatability = SplitHalfRepeatability(
      SelfCalibration().adjust,
      options_.refinement.bundle_adjustment.max_num_iterations,
      beliefs,
      model);
  timer.Finish(&result_.stages);
}

BundleAdjustmentOptions DepthGlobalMapper::FinalAdjustment() const {
  BundleAdjustmentOptions adjustment = options_.refinement.bundle_adjustment;
  adjustment.loss_scale_px = final_loss_scale_px_;
  adjustment.intrinsics.refine_principal_point =
      options_.refinement.refine_principal_point &&
      !options_.skip_self_calibration;
  return adjustment;
}

void DepthGlobalMapper::HoldImplausibleCameras(CameraBeliefs* beliefs,
                                               colmap::Reconstruction* model) {
  const std::set<colmap::camera_t> implausible = ImplausibleCameras(*model);
  if (implausible.empty()) return;
  for (const colmap::camera_t camera_id : implausible) {
    // As averaged, before the adjustment.
    model->Camera(camera_id).SetParams(scene_.cameras.at(camera_id).Params());
    beliefs->held_cameras.insert(camera_id);
    for (CameraGroup& group : beliefs->groups) {
      auto& ids = group.camera_ids;
      ids.erase(std::remove(ids.begin(), ids.end(), camera_id), ids.end());
    }
  }
  Warn("Bundle adjustment made the intrinsics of " +
       std::to_string(implausible.size()) +
       " cameras, the first of them camera " +
       std::to_string(*implausible.begin()) +
       ", implausible: they are held at what the image pairs tell. Give focal "
       "lengths (EXIF data) or leave their images out");
  SelfCalibration().adjust(
      *beliefs,
      options_.refinement.bundle_adjustment.max_num_iterations,
      model);
  FilterObservations(options_.refinement, 1.0, model);
}

SelfCalibrationOptions DepthGlobalMapper::SelfCalibration() {
  SelfCalibrationOptions options;
  options.grouping = options_.camera_grouping;
  options.tie_cameras = TiesCameras();
  options.bundle_adjustment = FinalAdjustment();
  options.adjust = [this](const CameraBeliefs& beliefs,
                          int max_num_iterations,
                          colmap::Reconstruction* model) {
    BundleAdjustmentOptions adjustment = FinalAdjustment();
    adjustment.max_num_iterations =
        std::min(adjustment.max_num_iterations, max_num_iterations);
    return AdjustBundle(
               adjustment,
               options_.num_threads,
               AnchorImage(*model),
               beliefs,
               PriorsInNeed(options_.refinement, *model, depth_priors_),
               model)
        .has_value();
  };
  return options;
}

void DepthGlobalMapper::CalibrateCameras(CameraBeliefs* beliefs,
                                         colmap::Reconstruction* model) {
  StageTimer timer("self_calibration");
  *beliefs = CalibrateModel(SelfCalibration(), *beliefs, model);
  timer.Add("groups", double(beliefs->groups.size()))
      .Add("cameras", double(beliefs->NumTiedCameras()))
      .Add("principal_points_held",
           double(beliefs->held_principal_points.size()));
  timer.Finish(&result_.stages);
}

// Of pairs between images of the model only: about others it knows nothing.
void DepthGlobalMapper::JudgePairsByModel(const colmap::Reconstruction& model,
                                          PairGeometries* pairs) {
  auto graph = std::make_unique<colmap::CorrespondenceGraph>();
  BuildCorrespondenceGraph(scene_,
                           *pairs,
                           verification_,
                           options_.refinement.max_epipolar_error_px,
                           model,
                           graph.get());
  const auto is_registered = [&](colmap::image_t image_id) {
    return model.ExistsImage(image_id) && model.IsImageRegistered(image_id);
  };
  for (auto& [pair_id, pair] : *pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (!is_registered(image_id1) || !is_registered(image_id2)) continue;
    const bool agrees =
        graph->NumCorrespondencesBetweenImages(image_id1, image_id2) > 0;
    if (agrees && pair.status != PairStatus::VALID) {
      result_.readmitted_pairs.emplace(pair_id, pair.status);
      pair.status = PairStatus::VALID;
    } else if (!agrees && pair.status == PairStatus::VALID) {
      pair.status = PairStatus::MODEL_OUTLIER;
    }
  }
}

void DepthGlobalMapper::FinishModel(const ImageCenters& start_centers,
                                    colmap::Reconstruction* model) {
  StageTimer timer("metric_scale");
  for (const auto& [image_id, reason] :
       FilterImages(options_.refinement, model)) {
    result_.unregistered_images[image_id] = reason;
  }
  const MetricScale metric = NormalizeToDepth(depths_, model);
  for (const auto& [image_id, scale] : DepthScalesOfModel(depths_, *model)) {
    result_.depth_scales[image_id] = scale.scale;
  }
  UpdatePointErrors(model);
  model->TearDown();
  if (const auto advice = CameraModelAdvice(MeasureRadialErrors(*model))) {
    Warn(*advice);
  }
  timer.Add("images", double(model->NumRegImages()))
      .Add("points", double(model->NumPoints3D()))
      .Add("scale_factor", metric.factor)
      .Add("log_scale_spread", metric.log_spread)
      .Add("scale_from_start", ScaleBetween(start_centers, CentersOf(*model)))
      .Add("images_with_scale", double(metric.num_images));
  timer.Finish(&result_.stages);
}

void DepthGlobalMapper::MeasureUnits() {
  for (const auto& model : result_.models) {
    const MeasuredUnit unit =
        UnitOfModel(depths_, result_.depth_scales, *model);
    result_.units.push_back(unit);
    if (!unit.IsDoubtful()) continue;
    std::ostringstream factor;
    factor << std::setprecision(2) << std::exp(unit.log_spread);
    Warn("The scales of the depth maps of a model with " +
         std::to_string(model->NumRegImages()) +
         " images differ by a factor of " + factor.str() +
         " (one standard deviation): its unit is not metres. Check that the "
         "maps are metric and belong to the images, or scale the model by "
         "known positions (colmap model_aligner)");
  }
}

void DepthGlobalMapper::Warn(const std::string& warning) {
  LOG(WARNING) << warning;
  result_.warnings.push_back(warning);
}

void DepthGlobalMapper::WarnOfPlanes(const PairGeometries& pairs) {
  constexpr double kMaxPlanarShare = 0.8;
  size_t num_valid = 0, num_planar = 0;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    ++num_valid;
    num_planar += pair.Has(PairDegeneracy::PLANAR);
  }
  const bool are_known = std::all_of(
      scene_.cameras.begin(), scene_.cameras.end(), [&](const auto& camera) {
        return camera.second.HasPriorFocalLength() ||
               beliefs_.focal_priors.count(camera.first) > 0;
      });
  if (are_known || double(num_planar) <= kMaxPlanarShare * double(num_valid)) {
    return;
  }
  Warn(
      std::to_string(num_planar) + " of " + std::to_string(num_valid) +
      " valid pairs see one plane only, which leaves unknown focal lengths "
      "open: focal lengths and heights may be wrong. Give focal lengths (EXIF "
      "data, or --ImageReader.camera_params and a prior), or add tilted views");
}

void DepthGlobalMapper::ExplainMissingImages(const PairGeometries& pairs) {
  std::map<colmap::image_t, std::map<PairStatus, size_t>> pair_statuses;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    ++pair_statuses[image_id1][pair.status];
    ++pair_statuses[image_id2][pair.status];
  }
  std::set<colmap::image_t> registered;
  for (const auto& model : result_.models) {
    registered.insert(model->RegImageIds().begin(), model->RegImageIds().end());
  }
  for (const auto& [image_id, image] : scene_.images) {
    if (registered.count(image_id) > 0) {
      result_.unregistered_images.erase(image_id);
      continue;
    }
    if (result_.unregistered_images.count(image_id) > 0) continue;
    std::string& reason = result_.unregistered_images[image_id];
    if (image.NumPoints2D() == 0) {
      reason = "no key points";
    } else if (pair_statuses[image_id].empty()) {
      reason = "no matches with other images";
    } else {
      reason = "no valid pair:";
      for (const auto& [status, count] : pair_statuses[image_id]) {
        reason += " " + std::to_string(count) + " " + PairStatusName(status);
      }
    }
  }
}

}  // namespace dgsfm
