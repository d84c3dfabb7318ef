#include "controllers/pair_shard_verifier.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "controllers/relative_depth_stage.h"
#include "sfm/intrinsics/prior_trust.h"
#include "sfm/verification/pair_fingerprint.h"

#include <filesystem>
#include <set>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

using PairSizes = DatabasePairVerifier::PairSizes;

void BindShardOptions(DepthGeometricVerifierOptions* options,
                      CommandOptions* command_options) {
  command_options->Add("use_depth", &options->use_depth, "");
  command_options->Add("intrinsics_prior", &options->intrinsics_prior, "");
  BindVerification(&options->verification, command_options);
}

DepthDatabase::Mode DepthMode(const DepthGeometricVerifierOptions& options) {
  return options.IsShard() ? DepthDatabase::Mode::UNCHANGING
                           : DepthDatabase::Mode::READ_ONLY;
}

// Reads the features of images into the scene, and their depths.
void ReadFeatures(const DepthGeometricVerifierOptions& options,
                  const std::set<colmap::image_t>& image_ids,
                  ShardInput* input) {
  const SqliteConnection connection(options.database_path, options.ReadMode());
  const DepthDatabase database(options.database_path, DepthMode(options));
  for (const colmap::image_t image_id : image_ids) {
    colmap::Image& image = input->scene.images.at(image_id);
    image.SetPoints2D(ReadKeypoints(connection, image));
    if (!options.use_depth) continue;
    if (auto depths = database.ReadKeypointDepths(image_id)) {
      input->depths.emplace(image_id, std::move(*depths));
    }
  }
}

// Whether a file has the result of a shard as it would be computed now.
bool HoldsResult(const std::string& path,
                 const PairShardHeader& header,
                 const PairSizes& pairs,
                 PairTotals* totals,
                 DatabasePairVerifier* verifier) {
  if (!fs::exists(path) || fs::is_empty(path)) return false;
  try {
    const PairShardFile file(path);
    if (file.Header().shard_index != header.shard_index ||
        file.Header().num_shards != header.num_shards ||
        file.Header().method_version != header.method_version ||
        file.Header().options_text != header.options_text) {
      return false;
    }
    const auto comparison = verifier->Compare(pairs, file.ReadFingerprints());
    if (!comparison.work.empty() || !comparison.stale.empty()) return false;
    file.ForEach([&](colmap::image_pair_t, const PairGeometry& pair) {
      totals->Add(pair.status, pair.degeneracies, 1);
    });
    return true;
  } catch (const DatabaseError& error) {
    LOG(WARNING) << "The shard is verified again: " << error.what();
    *totals = PairTotals();
    return false;
  }
}

// What the database has of the pairs already, which are sorted.
PairGeometries StoredPairs(const DepthGeometricVerifierOptions& options,
                           const PairSizes& pairs) {
  if (pairs.empty()) return {};
  return DepthDatabase(options.database_path, DepthMode(options))
      .ReadPairGeometries({}, [&](colmap::image_pair_t pair_id) {
        return pair_id >= pairs.front().pair_id &&
               pair_id <= pairs.back().pair_id;
      });
}

DatabasePairVerifier::Fingerprints FingerprintsOf(
    const PairGeometries& geometries) {
  DatabasePairVerifier::Fingerprints fingerprints;
  for (const auto& [pair_id, pair] : geometries) {
    fingerprints[pair_id] = pair.fingerprint;
  }
  return fingerprints;
}

}  // namespace

std::string ShardOptionsText(const DepthGeometricVerifierOptions& options) {
  DepthGeometricVerifierOptions bound = options;
  bound.verification.num_threads = -1;
  CommandOptions command_options("", "");
  BindShardOptions(&bound, &command_options);
  return command_options.ProjectText();
}

DepthGeometricVerifierOptions OptionsOfShard(const std::string& options_text) {
  DepthGeometricVerifierOptions options;
  CommandOptions command_options("", "");
  BindShardOptions(&options, &command_options);
  command_options.SetFromProjectText(options_text);
  return options;
}

PairSizes PairsOfShard(const PairSizes& pairs,
                       int shard_index,
                       int num_shards) {
  // Pairs without matches take time, too.
  const auto weight = [](const MatchReader::PairSize& pair) {
    return double(pair.num_matches) + 1;
  };
  double total = 0;
  for (const MatchReader::PairSize& pair : pairs) total += weight(pair);
  PairSizes selected;
  double before = 0;
  for (const MatchReader::PairSize& pair : pairs) {
    const double middle = before + weight(pair) / 2;
    before += weight(pair);
    if (int(middle / total * num_shards) == shard_index) {
      selected.push_back(pair);
    }
  }
  return selected;
}

Scene ReadShardScene(const DepthGeometricVerifierOptions& options) {
  Scene scene = ReadScene(
      options.database_path, SceneContent::IMAGES, options.ReadMode());
  SortPriors(*PriorTrustFromName(options.intrinsics_prior), &scene);
  return scene;
}

PairSizes ListPairs(const DepthGeometricVerifierOptions& options,
                    const Scene& scene) {
  const SqliteConnection connection(options.database_path, options.ReadMode());
  return MatchReader(connection, scene).ListPairs();
}

ShardInput ReadShardInput(const DepthGeometricVerifierOptions& options,
                          const Scene& scene,
                          const PairSizes& pairs) {
  std::set<colmap::image_t> image_ids;
  for (const MatchReader::PairSize& pair : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair.pair_id);
    image_ids.insert({image_id1, image_id2});
  }
  ShardInput input;
  input.scene = scene;
  ReadFeatures(options, image_ids, &input);
  if (!HasAffineDepths(input.depths)) return input;
  // Scale and shift of a map depend on pairs of other shards.
  for (const auto& [image_id, image] : scene.images) image_ids.insert(image_id);
  input = ShardInput();
  input.scene = scene;
  ReadFeatures(options, image_ids, &input);
  std::vector<StageReport> stages;
  input.conversions =
      ConvertRelativeDepths(options, &input.scene, &input.depths, &stages)
          .conversions;
  return input;
}

VerificationSummary VerifyPairShard(
    const DepthGeometricVerifierOptions& options) {
  CheckOptions(options);
  CheckPairShardPath(options.output_path);
  const std::string stamp = ChangeStamp(options.database_path);
  const Scene scene = ReadShardScene(options);
  const PairSizes pairs = PairsOfShard(
      ListPairs(options, scene), options.shard_index, options.num_shards);
  ShardInput input = ReadShardInput(options, scene, pairs);
  if (options.use_depth && input.depths.empty() && !pairs.empty()) {
    LOG(WARNING) << "No image of this shard has depth";
  }
  StageTimer timer("pair_verification");
  DatabasePairVerifier verifier =
      CreatePairVerifier(options, input.scene, input.depths);
  verifier.SetConversions(std::move(input.conversions));
  const PairShardHeader header = {options.shard_index,
                                  options.num_shards,
                                  PairMethodVersion(),
                                  ShardOptionsText(options)};
  VerificationSummary summary;
  if (!options.restart &&
      HoldsResult(
          options.output_path, header, pairs, &summary.totals, &verifier)) {
    LOG(INFO) << options.output_path << " has the result of this shard already";
    summary.num_kept = pairs.size();
    return summary;
  }
  PairGeometries geometries;
  if (!options.restart) geometries = StoredPairs(options, pairs);
  const auto comparison = verifier.Compare(pairs, FingerprintsOf(geometries));
  for (const colmap::image_pair_t pair_id : comparison.stale) {
    geometries.erase(pair_id);
  }
  summary.num_kept = comparison.holding.size();
  verifier.Verify(comparison.work,
                  [&](colmap::image_pair_t pair_id, PairGeometry pair) {
                    geometries[pair_id] = std::move(pair);
                  });
  if (ChangeStamp(options.database_path) != stamp) {
    throw DatabaseError(options.database_path)
        << "was written while a shard of its pairs was verified, which reads "
           "it without locks; verify the shard again";
  }
  WritePairShard(options.output_path, header, geometries);
  for (const auto& [pair_id, pair] : geometries) {
    summary.totals.Add(pair.status, pair.degeneracies, 1);
  }
  std::vector<StageReport> stages;
  timer.Add(summary.totals).Finish(&stages);
  return summary;
}

}  // namespace dgsfm
