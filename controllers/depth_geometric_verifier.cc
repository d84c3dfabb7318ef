#include "controllers/depth_geometric_verifier.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/database/depth_database.h"
#include "controllers/commands/commands.h"
#include "controllers/pair_shard_verifier.h"
#include "controllers/relative_depth_stage.h"
#include "estimators/option_check.h"
#include "sfm/intrinsics/prior_trust.h"

#include <algorithm>
#include <chrono>
#include <iostream>
#include <stdexcept>
#include <utility>

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

// Stores finished pairs from time to time: what a run that is broken off loses.
class CheckpointedPairs {
 public:
  CheckpointedPairs(double interval_s, const PairStore& store)
      : interval_s_(interval_s), store_(store) {}

  void Add(colmap::image_pair_t pair_id, PairGeometry pair) {
    finished_.emplace(pair_id, std::move(pair));
    const std::chrono::duration<double> waited = Clock::now() - last_stored_;
    if (waited.count() >= interval_s_ || finished_.size() >= kMaxNumFinished) {
      Store();
    }
  }

  void Store() {
    if (!finished_.empty()) store_(finished_);
    finished_.clear();
    last_stored_ = Clock::now();
  }

 private:
  using Clock = std::chrono::steady_clock;
  // Bounds the memory of pairs that wait to be stored.
  static constexpr size_t kMaxNumFinished = 1000;

  const double interval_s_;
  const PairStore& store_;
  PairGeometries finished_;
  Clock::time_point last_stored_ = Clock::now();
};

// The paper has estimators for pairs with depth, and for known focal lengths.
void CheckEstimatorsOfPaper(const DepthGeometricVerifierOptions& options,
                            const Scene& scene,
                            const KeypointDepthMap& depths) {
  const bool has_focals = std::any_of(
      scene.cameras.begin(), scene.cameras.end(), [](const auto& camera) {
        return camera.second.HasPriorFocalLength();
      });
  if (options.verification.two_view.paper && depths.empty() && !has_focals &&
      !scene.cameras.empty()) {
    throw std::runtime_error(
        "--paper 1 has no estimator for images without depth whose focal "
        "lengths are unknown: leave it out, import depth maps "
        "(depth_importer), or give focal lengths");
  }
}

}  // namespace

bool DepthGeometricVerifierOptions::IsValid(std::string* error) const {
  if (!PriorTrustFromName(intrinsics_prior)) {
    *error = "intrinsics_prior must be auto, exif or calibrated, but is '" +
             intrinsics_prior + "'";
    return false;
  }
  if (num_shards != 1 && output_path.empty()) {
    *error = "num_shards needs output_path, the file of the shard's result";
    return false;
  }
  return OptionBounds(error)
      .Valid(verification)
      .AtLeast("checkpoint_interval", checkpoint_interval_s, 0)
      .Within("num_shards", num_shards, 1, kMaxNumPairShards)
      .Within("shard_index", shard_index, 0, num_shards - 1)
      .AreKept();
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
           "share of its matches that a pair must keep [1]");
  command_options->Add(
      "random_seed", &options->random_seed, "seed of all random numbers");
  command_options->Add(
      "num_threads", &options->num_threads, "threads, -1 = all cores");
}

std::string VerificationText(PairVerificationOptions options) {
  options.num_threads = -1;
  CommandOptions command_options("", "");
  BindVerification(&options, &command_options);
  return command_options.ProjectText();
}

void BindOptions(DepthGeometricVerifierOptions* options,
                 CommandOptions* command_options) {
  BindVerificationOptions(options, command_options);
  command_options->Add("checkpoint_interval",
                       &options->checkpoint_interval_s,
                       "time after which finished pairs are stored [s]");
  command_options->Add(
      "restart",
      &options->restart,
      "verify all pairs again, not only those whose matches, depths or options "
      "are new");
  command_options->Add("output_path",
                       &options->output_path,
                       "file of the result of a shard, for "
                       "pair_geometry_merger; the database is only read, and "
                       "nobody may write it meanwhile; empty = all pairs, into "
                       "the database");
  command_options->Add(
      "shard_index", &options->shard_index, "which shard of the pairs, from 0");
  command_options->Add("num_shards",
                       &options->num_shards,
                       "shards that the pairs are divided into, of about as "
                       "many matches each");
}

void BindVerificationOptions(DepthGeometricVerifierOptions* options,
                             CommandOptions* command_options) {
  command_options->AddRequired(
      "database_path", &options->database_path, "COLMAP database");
  command_options->Add(
      "use_depth", &options->use_depth, "use the imported depth");
  command_options->Add(
      "intrinsics_prior",
      &options->intrinsics_prior,
      "what prior focal lengths are: calibrated (held within 1 %, with "
      "principal point and distortion), exif (within 5 %, the rest is "
      "unknown), or auto: exif where principal point and distortion are those "
      "that COLMAP gives photos with EXIF data");
  BindVerification(&options->verification, command_options);
}

KeypointDepthMap LoadDepths(const DepthGeometricVerifierOptions& options,
                            const Scene& scene,
                            std::vector<StageReport>* stages) {
  StageTimer timer("load_depth");
  KeypointDepthMap depths;
  if (options.use_depth) {
    depths =
        DepthDatabase(options.database_path, DepthDatabase::Mode::READ_ONLY)
            .ReadAllKeypointDepths(scene.kept_keypoints,
                                   [&](colmap::image_t image_id) {
                                     return scene.images.count(image_id) > 0;
                                   });
    if (depths.empty()) {
      LOG(WARNING) << options.database_path
                   << " has no depth priors (import them with depth_importer): "
                      "mapping without metric scale";
    }
  }
  CheckEstimatorsOfPaper(options, scene, depths);
  timer.Add("images", double(depths.size()));
  timer.Finish(stages);
  return depths;
}

Scene LoadScene(const DepthGeometricVerifierOptions& options,
                int max_num_keypoints,
                const std::optional<ImageNames>& names,
                std::vector<StageReport>* stages) {
  StageTimer timer("load_scene");
  Scene scene = ReadPartOfScene(
      options.database_path, max_num_keypoints, names, SceneContent::PAIRS);
  SortPriors(*PriorTrustFromName(options.intrinsics_prior), &scene);
  const size_t num_exif = scene.focal_priors.size();
  size_t num_calibrated = 0;
  for (const auto& [camera_id, camera] : scene.cameras) {
    num_calibrated += camera.HasPriorFocalLength();
  }
  timer.Add("cameras", double(scene.cameras.size()))
      .Add("cameras_calibrated", double(num_calibrated))
      .Add("cameras_with_exif", double(num_exif))
      .Add("images", double(scene.images.size()))
      .Add("pairs", double(scene.matches.size()));
  if (!scene.kept_keypoints.empty()) {
    timer.Add("images_with_kept_keypoints",
              double(scene.kept_keypoints.size()));
  }
  timer.Finish(stages);
  return scene;
}

DatabasePairVerifier CreatePairVerifier(
    const DepthGeometricVerifierOptions& options,
    const Scene& scene,
    const KeypointDepthMap& depths) {
  return DatabasePairVerifier(options.database_path,
                              options.use_depth,
                              options.verification,
                              VerificationText(options.verification),
                              scene,
                              depths,
                              options.ReadMode());
}

void VerifyAndStore(const DepthGeometricVerifierOptions& options,
                    const DatabasePairVerifier::PairSizes& pairs,
                    const PairStore& store,
                    DatabasePairVerifier* verifier) {
  CheckpointedPairs finished(options.checkpoint_interval_s, store);
  try {
    verifier->Verify(pairs,
                     [&](colmap::image_pair_t pair_id, PairGeometry pair) {
                       finished.Add(pair_id, std::move(pair));
                     });
  } catch (const Cancelled&) {
    finished.Store();
    throw;
  }
  finished.Store();
}

size_t VerificationSummary::NumPairs() const {
  size_t num_pairs = 0;
  for (const auto& [status, count] : totals.num_with_status) num_pairs += count;
  return num_pairs;
}

size_t VerificationSummary::NumValidPairs() const {
  const auto valid = totals.num_with_status.find(PairStatus::VALID);
  return valid == totals.num_with_status.end() ? 0 : valid->second;
}

VerificationSummary VerifyDatabasePairs(
    const DepthGeometricVerifierOptions& options) {
  CheckOptions(options);
  DepthDatabase database(options.database_path,
                         DepthDatabase::Mode::READ_WRITE);
  std::vector<StageReport> stages;
  Scene scene = ReadScene(options.database_path, SceneContent::FEATURES);
  SortPriors(*PriorTrustFromName(options.intrinsics_prior), &scene);
  KeypointDepthMap depths = LoadDepths(options, scene, &stages);
  RelativeDepths relative =
      ConvertRelativeDepths(options, &scene, &depths, &stages);
  StageTimer timer("pair_verification");
  DatabasePairVerifier verifier = CreatePairVerifier(options, scene, depths);
  verifier.SetConversions(std::move(relative.conversions));
  const DatabasePairVerifier::Fingerprints stored =
      database.ReadPairFingerprints();
  const auto comparison = verifier.Compare(
      verifier.ListPairs(),
      options.restart ? DatabasePairVerifier::Fingerprints() : stored);
  VerificationSummary summary;
  summary.num_kept = comparison.holding.size();
  summary.num_deleted = stored.size() - summary.num_kept;
  if (options.restart) {
    database.DeleteAllPairGeometries();
  } else {
    database.DeletePairGeometries(comparison.stale);
  }
  VerifyAndStore(
      options,
      comparison.work,
      [&](const PairGeometries& pairs) { database.WritePairGeometries(pairs); },
      &verifier);
  summary.totals = database.ReadPairTotals();
  timer.Add("kept", double(summary.num_kept))
      .Add(options.restart ? "restarted" : "deleted",
           double(summary.num_deleted))
      .Add(summary.totals)
      .Finish(&stages);
  return summary;
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
  const VerificationSummary summary = options.IsShard()
                                          ? VerifyPairShard(options)
                                          : VerifyDatabasePairs(options);
  std::cout << "verified " << summary.NumPairs() << " pairs, "
            << summary.NumValidPairs() << " valid" << std::endl;
  return 0;
}

}  // namespace dgsfm
