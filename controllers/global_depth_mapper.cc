#include "controllers/global_depth_mapper.h"

#include "colmap_ext/depth_database.h"
#include "colmap_ext/scene_database.h"
#include "controllers/commands.h"
#include "controllers/pair_score_file.h"
#include "controllers/progress.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <set>
#include <sstream>
#include <stdexcept>

#include <glog/logging.h>
#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

template <typename Options>
void ThrowUnlessValid(const Options& options) {
  std::string error;
  if (!options.IsValid(&error)) throw std::runtime_error(error);
}

KeypointDepthMap LoadDepths(const std::string& database_path,
                            bool use_depth,
                            std::vector<StageReport>* stages) {
  StageTimer timer("load_depth");
  KeypointDepthMap depths;
  if (use_depth) {
    depths = DepthDatabase(database_path, DepthDatabase::Mode::READ_ONLY)
                 .ReadAllKeypointDepths();
    if (depths.empty()) {
      LOG(WARNING) << database_path
                   << " has no depth priors (import them with depth_importer): "
                      "mapping without metric scale";
    }
  }
  timer.Add("images", double(depths.size()));
  timer.Finish(stages);
  return depths;
}

Scene LoadScene(const std::string& database_path,
                std::vector<StageReport>* stages) {
  StageTimer timer("load_scene");
  Scene scene = ReadScene(database_path);
  timer.Add("cameras", double(scene.cameras.size()))
      .Add("images", double(scene.images.size()))
      .Add("pairs", double(scene.matches.size()));
  timer.Finish(stages);
  return scene;
}

PairGeometries VerifyWithProgress(const Scene& scene,
                                  const KeypointDepthMap& depths,
                                  const PairVerificationOptions& options,
                                  std::vector<StageReport>* stages) {
  StageTimer timer("pair_verification");
  Progress progress("Verifying pairs", scene.matches.size());
  PairGeometries pairs =
      VerifyPairs(scene, depths, options, [&progress]() { progress.Step(); });
  for (const auto& [status, count] : CountByStatus(pairs)) {
    timer.Add(PairStatusName(status), double(count));
  }
  timer.Finish(stages);
  return pairs;
}

void BindVerification(PairVerificationOptions* options,
                      CommandOptions* command_options) {
  CommandOptions& bind = *command_options;
  TwoViewDepthOptions& two_view = options->two_view;
  bind.Add("TwoViewDepth.max_epipolar_error",
           &two_view.max_epipolar_error_px,
           "Sampson error below which a match is an inlier [px]");
  bind.Add("TwoViewDepth.max_reprojection_error",
           &two_view.max_reprojection_error_px,
           "reprojection error that weighs as much in the paper's hybrid "
           "refinement [px]");
  bind.Add("TwoViewDepth.min_num_trials",
           &two_view.min_num_trials,
           "least number of RANSAC trials");
  bind.Add("TwoViewDepth.max_num_trials",
           &two_view.max_num_trials,
           "largest number of RANSAC trials");
  bind.Add("TwoViewDepth.confidence",
           &two_view.confidence,
           "probability that no better model is left [1]");
  bind.Add("TwoViewDepth.min_focal_length_ratio",
           &two_view.min_focal_length_ratio,
           "smallest plausible focal length [larger image side]");
  bind.Add("TwoViewDepth.max_focal_length_ratio",
           &two_view.max_focal_length_ratio,
           "largest plausible focal length [larger image side]");
  bind.Add("TwoViewDepth.min_num_depth_matches",
           &two_view.min_num_depth_matches,
           "pairs with fewer matches with depth are estimated without");
  bind.Add("TwoViewDepth.paper",
           &two_view.paper,
           "estimator as published instead of the whitened refinement");
  bind.Add("DepthConsistency.max_reprojection_error",
           &options->depth_consistency.max_reprojection_error_px,
           "largest error of a match transferred by its depth [px]");
  bind.Add("DepthConsistency.max_depth_error_ratio",
           &options->depth_consistency.max_depth_error_ratio,
           "largest relative depth error of a transferred match [1]");
  bind.Add("DepthConsistency.tolerate_depth_error",
           &options->depth_consistency.tolerate_depth_error,
           "let a transferred match be off by what that depth error explains");
  bind.Add("PairVerification.filter_depth",
           &options->filter_depth,
           "remove matches that contradict the depth maps");
  bind.Add("PairVerification.depth_noise_factor",
           &options->depth_noise_factor,
           "depth error a match may show, at least [pair's depth noise]");
  bind.Add("PairVerification.min_num_inliers",
           &options->min_num_inliers,
           "matches that a pair must keep");
  bind.Add("PairVerification.min_inlier_ratio",
           &options->min_inlier_ratio,
           "share of its matches that a pair must keep [1]");
  bind.Add("PairVerification.max_scale_ratio",
           &options->max_scale_ratio,
           "largest plausible ratio of depth scales, either way [1]");
  bind.Add("random_seed", &options->random_seed, "seed of all random numbers");
  bind.Add("num_threads", &options->num_threads, "threads, -1 = all cores");
}

void BindMapper(DepthGlobalMapperOptions* options, CommandOptions* bind) {
  const std::string group = "DepthGlobalMapper.";
  bind->Add(group + "min_pair_score",
            &options->view_graph.min_pair_score,
            "pairs with an imported score up to this are removed [1]");
  bind->Add(group + "min_triplet_support",
            &options->view_graph.min_triplet_support,
            "pairs with a mean triplet support up to this are removed [1]");
  bind->Add(group + "keep_connected",
            &options->view_graph.keep_connected,
            "keep pairs below the triplet support that alone connect parts");
  bind->Add(group + "num_rotation_averaging_rounds",
            &options->num_rotation_averaging_rounds,
            "rounds of rotation averaging, each with a filter");
  bind->Add(group + "max_rotation_error",
            &options->max_rotation_error_deg,
            "pairs farther off the averaged rotations are removed [deg]");
  bind->Add(group + "max_log_scale_error",
            &options->max_log_scale_error,
            "pairs farther off the averaged scales lose theirs [log]");
  bind->Add(group + "track_min_num_views",
            &options->tracks.min_num_views_per_track,
            "images a track must be seen in");
  bind->Add(group + "track_min_num_per_view",
            &options->tracks.min_num_tracks_per_view,
            "images with fewer tracks also use two-view tracks");
  bind->Add(group + "init_use_depth",
            &options->position_initialization.use_depth,
            "start centres and points from depth");
  bind->Add(group + "init_use_median",
            &options->position_initialization.use_median,
            "start points at the median of their lifts, else at the mean");
  ModelRefinementOptions& refinement = options->refinement;
  bind->Add(group + "gp_max_num_iterations",
            &refinement.global_positioning.max_num_iterations,
            "iterations of global positioning");
  bind->Add(group + "gp_loss_scale",
            &refinement.global_positioning.loss_scale,
            "Huber threshold of global positioning [sine of angle]");
  bind->Add(group + "max_angular_error",
            &refinement.max_angular_error_deg,
            "observations farther off after positioning are removed [deg]");
  bind->Add(group + "ba_num_rounds",
            &refinement.num_bundle_adjustment_rounds,
            "rounds of bundle adjustment, each with a filter");
  bind->Add(group + "ba_max_num_iterations",
            &refinement.bundle_adjustment.max_num_iterations,
            "iterations of each bundle adjustment");
  bind->Add(group + "ba_loss_scale",
            &refinement.bundle_adjustment.loss_scale_px,
            "residual from which the soft L1 loss grows linearly [px]");
  bind->Add(group + "ba_refine_focal_length",
            &refinement.bundle_adjustment.refine_focal_length,
            "refine focal lengths");
  bind->Add(group + "ba_refine_extra_params",
            &refinement.bundle_adjustment.refine_extra_params,
            "refine distortion");
  bind->Add(group + "ba_refine_principal_point",
            &refinement.refine_principal_point,
            "refine principal points once the model is complete");
  bind->Add(group + "ba_principal_point_stddev",
            &refinement.bundle_adjustment.principal_point_stddev_ratio,
            "prior of the principal point [larger image side]");
  bind->Add(group + "ba_extra_params_stddev",
            &refinement.bundle_adjustment.extra_params_stddev,
            "prior of distortion parameters [1]");
  bind->Add(group + "max_reprojection_error",
            &refinement.max_reprojection_error_px,
            "observations farther off after the last round are removed [px]");
  bind->Add(group + "min_triangulation_angle",
            &refinement.min_triangulation_angle_deg,
            "points with a smaller triangulation angle are removed [deg]");
  bind->Add(group + "tri_max_epipolar_error",
            &refinement.max_epipolar_error_px,
            "distance from the epipolar line of matches to triangulate [px]");
  bind->Add(group + "max_completion_error",
            &refinement.max_completion_error_px,
            "largest error when tracks are completed and merged [px]");
  bind->Add(group + "min_num_points_per_image",
            &refinement.min_num_points_per_image,
            "images with fewer points are not registered");
  bind->Add(group + "min_model_size",
            &options->min_model_size,
            "models with fewer images are not written");
  bind->Add(group + "multiple_models",
            &options->multiple_models,
            "one model per connected component, else only the largest");
  const auto skip = [&](const std::string& stage, bool* value) {
    bind->Add(group + "skip_" + stage, value, "leave this stage out");
  };
  skip("pair_scores", &options->skip_pair_scores);
  skip("triplet_support", &options->skip_triplet_support);
  skip("focal_averaging", &options->skip_focal_averaging);
  skip("reverification", &options->skip_reverification);
  skip("scale_averaging", &options->skip_scale_averaging);
  skip("global_positioning", &options->skip_global_positioning);
  skip("bundle_adjustment", &options->skip_bundle_adjustment);
  skip("retriangulation", &options->skip_retriangulation);
}

// Thresholds of the paper's appendix; stages that it does not have are off.
void ApplyPaperPreset(GlobalDepthMapperOptions* options) {
  TwoViewDepthOptions& two_view = options->verifier.verification.two_view;
  two_view.paper = true;
  two_view.max_epipolar_error_px = 1.0;
  two_view.max_reprojection_error_px = 16.0;
  two_view.min_num_trials = 1000;
  two_view.max_num_trials = 1000;
  options->verifier.verification.depth_consistency.tolerate_depth_error = false;
  options->verifier.verification.depth_noise_factor = 0;
  DepthGlobalMapperOptions& mapper = options->mapper;
  mapper.view_graph.keep_connected = false;
  mapper.tracks.min_num_tracks_per_view = 0;
  mapper.refinement.bundle_adjustment.loss_scale_px = 1.0;
  mapper.refinement.refine_principal_point = false;
  mapper.skip_reverification = true;
  mapper.skip_retriangulation = true;
}

// Whether --paper is switched on: presets change defaults, which must be known
// before the other options are read.
bool RequestsPaperPreset(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--paper=1") return true;
    if (argument == "--paper" && i + 1 < argc) {
      return std::string(argv[i + 1]) == "1";
    }
  }
  return false;
}

void CheckImagesExist(const std::string& image_path, const Scene& scene) {
  size_t num_missing = 0;
  std::string first_missing;
  for (const auto& [image_id, image] : scene.images) {
    if (fs::exists(fs::path(image_path) / image.Name())) continue;
    if (num_missing++ == 0) first_missing = image.Name();
  }
  if (num_missing > 0) {
    throw std::runtime_error(
        image_path + " lacks " + std::to_string(num_missing) + " of " +
        std::to_string(scene.images.size()) + " images, e.g. " + first_missing +
        "; leave --image_path out to map without colours");
  }
}

void CreateOutputFolder(const std::string& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error || !fs::is_directory(path)) {
    throw std::runtime_error("cannot create the output folder " + path);
  }
}

}  // namespace

void BindOptions(DepthGeometricVerifierOptions* options,
                 CommandOptions* command_options) {
  command_options->AddRequired(
      "database_path", &options->database_path, "COLMAP database");
  command_options->Add(
      "use_depth", &options->use_depth, "use the imported depth");
  BindVerification(&options->verification, command_options);
}

void BindOptions(GlobalDepthMapperOptions* options,
                 CommandOptions* command_options) {
  BindOptions(&options->verifier, command_options);
  command_options->Add("image_path",
                       &options->image_path,
                       "folder of the images, for colours; empty = none");
  command_options->AddRequired("output_path",
                               &options->output_path,
                               "folder of the models, created if missing");
  command_options->Add("pair_scores_path",
                       &options->pair_scores_path,
                       "pair scores (Doppelgangers++), lines 'name1 name2 "
                       "score'; empty = none");
  command_options->Add(
      "paper", &options->paper, "method and thresholds of the paper");
  BindMapper(&options->mapper, command_options);
}

void VerifyDatabasePairs(const DepthGeometricVerifierOptions& options) {
  ThrowUnlessValid(options.verification);
  std::vector<StageReport> stages;
  const Scene scene = LoadScene(options.database_path, &stages);
  const KeypointDepthMap depths =
      LoadDepths(options.database_path, options.use_depth, &stages);
  const PairGeometries pairs =
      VerifyWithProgress(scene, depths, options.verification, &stages);
  DepthDatabase database(options.database_path,
                         DepthDatabase::Mode::READ_WRITE);
  database.BeginTransaction();
  database.DeletePairGeometries();
  database.WritePairGeometries(pairs);
  database.CommitTransaction();
  const std::map<PairStatus, size_t> counts = CountByStatus(pairs);
  const auto valid = counts.find(PairStatus::VALID);
  std::cout << "verified " << pairs.size() << " pairs, "
            << (valid == counts.end() ? 0 : valid->second) << " valid"
            << std::endl;
}

GlobalDepthMapper::GlobalDepthMapper(const GlobalDepthMapperOptions& options)
    : options_(options) {
  options_.mapper.num_threads = options_.verifier.verification.num_threads;
}

bool GlobalDepthMapper::Run() {
  ThrowUnlessValid(options_.verifier.verification);
  ThrowUnlessValid(options_.mapper);
  std::vector<StageReport> stages;
  const Scene scene = LoadScene(options_.verifier.database_path, &stages);
  if (!options_.image_path.empty()) {
    CheckImagesExist(options_.image_path, scene);
  }
  const KeypointDepthMap depths = LoadDepths(
      options_.verifier.database_path, options_.verifier.use_depth, &stages);
  PairScores scores;
  if (!options_.pair_scores_path.empty()) {
    scores = ReadPairScores(options_.pair_scores_path, scene);
  }
  PairGeometries pairs = LoadOrVerifyPairs(scene, depths, &stages);

  DepthGlobalMapper mapper(
      options_.mapper, options_.verifier.verification, scene, depths, scores);
  DepthGlobalMapperResult result = mapper.Run(&pairs);
  result.stages.insert(result.stages.begin(), stages.begin(), stages.end());
  WriteModels(&result);
  WriteReport(scene, pairs, result);

  size_t num_registered = 0;
  for (const auto& model : result.models) {
    num_registered += model->NumRegImages();
  }
  std::cout << "registered " << num_registered << " of " << scene.images.size()
            << " images in " << result.models.size() << " models in "
            << options_.output_path << std::endl;
  for (const auto& [image_id, reason] : result.unregistered_images) {
    std::cout << "not registered: " << scene.images.at(image_id).Name() << ": "
              << reason << std::endl;
  }
  return !result.models.empty();
}

PairGeometries GlobalDepthMapper::LoadOrVerifyPairs(
    const Scene& scene,
    const KeypointDepthMap& depths,
    std::vector<StageReport>* stages) {
  PairGeometries stored;
  if (options_.verifier.use_depth) {
    stored = DepthDatabase(options_.verifier.database_path,
                           DepthDatabase::Mode::READ_ONLY)
                 .ReadPairGeometries();
  }
  if (stored.empty()) {
    return VerifyWithProgress(
        scene, depths, options_.verifier.verification, stages);
  }
  PairGeometries pairs;
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto it = stored.find(pair_id);
    if (it == stored.end()) {
      const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
      throw std::runtime_error(
          options_.verifier.database_path + ": the pair " +
          scene.images.at(image_id1).Name() + ", " +
          scene.images.at(image_id2).Name() +
          " was matched after the verification: run depth_geometric_verifier "
          "again");
    }
    pairs[pair_id] = std::move(it->second);
  }
  LOG(INFO) << "Using " << pairs.size() << " verified pairs of "
            << options_.verifier.database_path;
  return pairs;
}

void GlobalDepthMapper::WriteModels(DepthGlobalMapperResult* result) {
  StageTimer timer("write_models");
  for (size_t i = 0; i < result->models.size(); ++i) {
    const std::string path =
        (fs::path(options_.output_path) / std::to_string(i)).string();
    CreateOutputFolder(path);
    if (!options_.image_path.empty()) {
      result->models[i]->ExtractColorsForAllImages(options_.image_path);
    }
    result->models[i]->Write(path);
  }
  timer.Add("models", double(result->models.size()));
  timer.Finish(&result->stages);
}

void GlobalDepthMapper::WriteReport(
    const Scene& scene,
    const PairGeometries& pairs,
    const DepthGlobalMapperResult& result) const {
  nlohmann::ordered_json report;
  for (const StageReport& stage : result.stages) {
    nlohmann::ordered_json entry;
    entry["stage"] = stage.stage;
    for (const auto& [figure, value] : stage.figures) entry[figure] = value;
    entry["seconds"] = stage.seconds;
    entry["peak_memory_mb"] = stage.peak_memory_mb;
    report["stages"].push_back(entry);
  }
  for (const auto& [status, count] : CountByStatus(pairs)) {
    report["pairs"][PairStatusName(status)] = count;
  }
  report["models"] = nlohmann::json::array();
  for (const auto& model : result.models) {
    report["models"].push_back(
        {{"images", model->NumRegImages()}, {"points", model->NumPoints3D()}});
  }
  for (const auto& [camera_id, focal] : result.focals) {
    report["cameras"].push_back(
        {{"camera_id", camera_id},
         {"focal_source", FocalSourceName(focal.source)},
         {"averaged_focal_length_px", focal.focal_length_px},
         {"num_estimates", focal.num_estimates},
         {"log_spread", focal.log_spread}});
  }
  for (const auto& [image_id, image] : scene.images) {
    nlohmann::ordered_json entry;
    entry["name"] = image.Name();
    const auto missing = result.unregistered_images.find(image_id);
    entry["registered"] = missing == result.unregistered_images.end();
    if (missing != result.unregistered_images.end()) {
      entry["reason"] = missing->second;
    }
    const auto scale = result.depth_scales.find(image_id);
    if (scale != result.depth_scales.end()) {
      entry["depth_scale"] = scale->second;
    }
    report["images"].push_back(entry);
  }
  const std::string path =
      (fs::path(options_.output_path) / "report.json").string();
  std::ofstream file(path);
  file << report.dump(2) << std::endl;
  if (!file) throw std::runtime_error("cannot write " + path);
}

int RunDepthGeometricVerifier(int argc, char** argv) {
  DepthGeometricVerifierOptions options;
  CommandOptions command_options(
      "depth_geometric_verifier",
      "Verifies image pairs with depth and stores the result in the database.");
  BindOptions(&options, &command_options);
  if (const auto exit_code = command_options.Parse(argc, argv)) {
    return *exit_code;
  }
  VerifyDatabasePairs(options);
  return 0;
}

int RunDepthGlobalMapper(int argc, char** argv) {
  GlobalDepthMapperOptions options;
  options.paper = RequestsPaperPreset(argc, argv);
  if (options.paper) ApplyPaperPreset(&options);
  CommandOptions command_options(
      "depth_global_mapper",
      "Reconstructs a database with depth priors by global "
      "structure from motion.");
  BindOptions(&options, &command_options);
  if (const auto exit_code = command_options.Parse(argc, argv)) {
    return *exit_code;
  }
  CreateOutputFolder(options.output_path);
  command_options.WriteProject(
      (fs::path(options.output_path) / "project.ini").string());
  if (GlobalDepthMapper(options).Run()) return 0;
  std::cerr << "ERROR: no model could be reconstructed, see "
            << (fs::path(options.output_path) / "report.json").string()
            << std::endl;
  return 1;
}

}  // namespace dgsfm
