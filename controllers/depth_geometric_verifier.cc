#include "controllers/depth_geometric_verifier.h"

#include "colmap_ext/depth_database.h"
#include "colmap_ext/scene_database.h"
#include "controllers/commands.h"
#include "controllers/progress.h"
#include "sfm/view_graph.h"

#include <iostream>

#include <glog/logging.h>

namespace dgsfm {

namespace {

void BindTwoView(TwoViewDepthOptions* options,
                 CommandOptions* command_options) {
  OptionGroup("TwoViewDepth", command_options)
      .Add("max_epipolar_error",
           &options->max_epipolar_error_px,
           "Sampson error below which a match is an inlier [px]")
      .Add("max_reprojection_error",
           &options->max_reprojection_error_px,
           "reprojection error that weighs as much in the paper's hybrid "
           "refinement [px]")
      .Add("min_num_trials",
           &options->min_num_trials,
           "least number of RANSAC trials")
      .Add("max_num_trials",
           &options->max_num_trials,
           "largest number of RANSAC trials")
      .Add("confidence",
           &options->confidence,
           "probability that no better model is left [1]")
      .Add("min_focal_length_ratio",
           &options->min_focal_length_ratio,
           "smallest plausible focal length [larger image side]")
      .Add("max_focal_length_ratio",
           &options->max_focal_length_ratio,
           "largest plausible focal length [larger image side]")
      .Add("min_num_depth_matches",
           &options->min_num_depth_matches,
           "pairs with fewer matches with depth are estimated without")
      .Add("paper",
           &options->paper,
           "estimator as published instead of the whitened refinement");
}

void BindDepthConsistency(DepthConsistencyOptions* options,
                          CommandOptions* command_options) {
  OptionGroup("DepthConsistency", command_options)
      .Add("max_reprojection_error",
           &options->max_reprojection_error_px,
           "largest error of a match transferred by its depth [px]")
      .Add("max_depth_error_ratio",
           &options->max_depth_error_ratio,
           "largest relative depth error of a transferred match [1]")
      .Add("tolerate_depth_error",
           &options->tolerate_depth_error,
           "let a transferred match be off by what that depth error explains");
}

void BindVerification(PairVerificationOptions* options,
                      CommandOptions* command_options) {
  BindTwoView(&options->two_view, command_options);
  BindDepthConsistency(&options->depth_consistency, command_options);
  OptionGroup("PairVerification", command_options)
      .Add("filter_depth",
           &options->filter_depth,
           "remove matches that contradict the depth maps")
      .Add("depth_noise_factor",
           &options->depth_noise_factor,
           "depth error a match may show, at least [pair's depth noise]")
      .Add("min_num_inliers",
           &options->min_num_inliers,
           "matches that a pair must keep")
      .Add("min_inlier_ratio",
           &options->min_inlier_ratio,
           "share of its matches that a pair must keep [1]")
      .Add("max_scale_ratio",
           &options->max_scale_ratio,
           "largest plausible ratio of depth scales, either way [1]");
  command_options->Add(
      "random_seed", &options->random_seed, "seed of all random numbers");
  command_options->Add(
      "num_threads", &options->num_threads, "threads, -1 = all cores");
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

KeypointDepthMap LoadDepths(const DepthGeometricVerifierOptions& options,
                            std::vector<StageReport>* stages) {
  StageTimer timer("load_depth");
  KeypointDepthMap depths;
  if (options.use_depth) {
    depths =
        DepthDatabase(options.database_path, DepthDatabase::Mode::READ_ONLY)
            .ReadAllKeypointDepths();
    if (depths.empty()) {
      LOG(WARNING) << options.database_path
                   << " has no depth priors (import them with depth_importer): "
                      "mapping without metric scale";
    }
  }
  timer.Add("images", double(depths.size()));
  timer.Finish(stages);
  return depths;
}

Scene LoadScene(const DepthGeometricVerifierOptions& options,
                std::vector<StageReport>* stages) {
  StageTimer timer("load_scene");
  Scene scene = ReadScene(options.database_path);
  timer.Add("cameras", double(scene.cameras.size()))
      .Add("images", double(scene.images.size()))
      .Add("pairs", double(scene.matches.size()));
  timer.Finish(stages);
  return scene;
}

PairGeometries VerifyScenePairs(const Scene& scene,
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

void VerifyDatabasePairs(const DepthGeometricVerifierOptions& options) {
  CheckOptions(options.verification);
  std::vector<StageReport> stages;
  const Scene scene = LoadScene(options, &stages);
  const KeypointDepthMap depths = LoadDepths(options, &stages);
  const PairGeometries pairs =
      VerifyScenePairs(scene, depths, options.verification, &stages);
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

}  // namespace dgsfm
