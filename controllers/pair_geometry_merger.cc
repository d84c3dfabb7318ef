#include "controllers/pair_geometry_merger.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/progress.h"
#include "controllers/commands/commands.h"
#include "controllers/pair_shard_verifier.h"
#include "estimators/option_check.h"
#include "sfm/verification/pair_fingerprint.h"

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <sstream>
#include <utility>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

using Shards = std::vector<std::unique_ptr<PairShardFile>>;

// Pairs that are held in memory on their way.
constexpr size_t kBatchSize = 1000;

// The first line that two texts differ in.
std::string DifferentLine(const std::string& text1, const std::string& text2) {
  std::istringstream stream1(text1), stream2(text2);
  std::string line1, line2;
  while (std::getline(stream1, line1) && std::getline(stream2, line2)) {
    if (line1 != line2) return line1 + " and " + line2;
  }
  return "the number of options";
}

// Their numbers, as in "1, 4-7"; empty if none is missing.
std::string NamesOfMissing(const Shards& shards) {
  std::string names;
  for (size_t i = 0; i < shards.size(); ++i) {
    if (shards[i]) continue;
    size_t last = i;
    while (last + 1 < shards.size() && !shards[last + 1]) ++last;
    names += (names.empty() ? "" : ", ") + std::to_string(i);
    if (last > i) names += "-" + std::to_string(last);
    i = last;
  }
  return names;
}

void CheckAgrees(const PairShardFile& shard, const PairShardFile& first) {
  const PairShardHeader& header = shard.Header();
  if (header.method_version != PairMethodVersion()) {
    throw DatabaseError(shard.Path())
        << "was verified by another version of the program (method "
        << header.method_version << ", here " << PairMethodVersion()
        << "); use one version for all shards and the merger";
  }
  if (header.num_shards != first.Header().num_shards) {
    throw DatabaseError(shard.Path())
        << "is one of " << header.num_shards << " shards, " << first.Path()
        << " one of " << first.Header().num_shards
        << "; give the shards of one verification";
  }
  if (header.options_text != first.Header().options_text) {
    throw DatabaseError(shard.Path())
        << "was verified with other options than " << first.Path() << " ("
        << DifferentLine(header.options_text, first.Header().options_text)
        << "); verify all shards with the same";
  }
}

// By their numbers.
Shards OpenShards(const std::vector<std::string>& paths) {
  Shards shards;
  const PairShardFile* first = nullptr;
  for (const std::string& path : paths) {
    auto shard = std::make_unique<PairShardFile>(path);
    if (first == nullptr) {
      first = shard.get();
      shards.resize(first->Header().num_shards);
    }
    CheckAgrees(*shard, *first);
    std::unique_ptr<PairShardFile>& place = shards[shard->Header().shard_index];
    if (place) {
      throw DatabaseError(path) << "is shard " << shard->Header().shard_index
                                << ", as is " << place->Path();
    }
    place = std::move(shard);
  }
  const std::string missing = NamesOfMissing(shards);
  if (!missing.empty()) {
    throw std::runtime_error("of " + std::to_string(shards.size()) +
                             " shards these are missing: " + missing +
                             "; verify them (--shard_index), or give their "
                             "files");
  }
  return shards;
}

// Throws if pairs of the shard are not those of the database.
void CheckShard(const DepthGeometricVerifierOptions& options,
                const Scene& scene,
                const DatabasePairVerifier::PairSizes& pairs,
                const PairShardFile& shard) {
  ShardInput input = ReadShardInput(options, scene, pairs);
  DatabasePairVerifier verifier =
      CreatePairVerifier(options, input.scene, input.depths);
  verifier.SetConversions(std::move(input.conversions));
  const auto comparison = verifier.Compare(pairs, shard.ReadFingerprints());
  if (comparison.work.empty() && comparison.stale.empty()) return;
  const auto [image_id1, image_id2] =
      ImageIdsOfPair(comparison.work.empty() ? comparison.stale.front()
                                             : comparison.work.front().pair_id);
  const auto name = [&](colmap::image_t image_id) {
    const auto found = scene.images.find(image_id);
    return found == scene.images.end() ? "image " + std::to_string(image_id)
                                       : found->second.Name();
  };
  throw DatabaseError(shard.Path())
      << "is of another database than " << options.database_path
      << ", or of an earlier state of it: "
      << std::max(comparison.work.size(), comparison.stale.size())
      << " pairs, e.g. " << name(image_id1) << " - " << name(image_id2)
      << ", have other matches, key points, depths or cameras; verify the "
         "shard again";
}

void CheckShards(const PairGeometryMergerOptions& options,
                 const Shards& shards) {
  DepthGeometricVerifierOptions verifier =
      OptionsOfShard(shards.front()->Header().options_text);
  verifier.database_path = options.database_path;
  verifier.verification.num_threads = options.num_threads;
  CheckOptions(verifier);
  const Scene scene = ReadShardScene(verifier);
  const auto pairs = ListPairs(verifier, scene);
  const int num_shards = int(shards.size());
  Progress progress("Checking shards", num_shards, num_shards);
  for (int i = 0; i < num_shards; ++i) {
    CheckShard(verifier, scene, PairsOfShard(pairs, i, num_shards), *shards[i]);
    progress.Step(1);
  }
}

void StoreShard(const PairShardFile& shard, DepthDatabase* database) {
  PairGeometries batch;
  const auto store = [&] {
    ThrowIfCancelled();
    database->WritePairGeometries(batch);
    batch.clear();
  };
  shard.ForEach([&](colmap::image_pair_t pair_id, const PairGeometry& pair) {
    batch.emplace(pair_id, pair);
    if (batch.size() == kBatchSize) store();
  });
  store();
}

}  // namespace

bool PairGeometryMergerOptions::IsValid(std::string* error) const {
  if (num_threads == 0 || num_threads < -1) {
    *error = "num_threads must be -1 or positive, but is " +
             std::to_string(num_threads);
    return false;
  }
  return true;
}

void BindOptions(PairGeometryMergerOptions* options,
                 CommandOptions* command_options) {
  command_options->Add(
      "num_threads", &options->num_threads, "threads, -1 = all cores");
}

std::vector<std::string> FindShardFiles(const std::string& shard_paths) {
  std::vector<std::string> files;
  std::istringstream stream(shard_paths);
  std::string path;
  while (std::getline(stream, path, ',')) {
    if (path.empty()) continue;
    if (!fs::is_directory(path)) {
      files.push_back(path);
      continue;
    }
    std::vector<std::string> of_folder;
    for (const auto& entry : fs::directory_iterator(path)) {
      if (entry.path().extension() == ".db") of_folder.push_back(entry.path());
    }
    if (of_folder.empty()) {
      throw std::runtime_error("folder " + path + " has no shards (*.db)");
    }
    std::sort(of_folder.begin(), of_folder.end());
    files.insert(files.end(), of_folder.begin(), of_folder.end());
  }
  if (files.empty()) throw std::runtime_error("shard_paths names no files");
  return files;
}

VerificationSummary MergePairShards(const PairGeometryMergerOptions& options) {
  CheckOptions(options);
  const Shards shards = OpenShards(FindShardFiles(options.shard_paths));
  DepthDatabase database(options.database_path,
                         DepthDatabase::Mode::READ_WRITE);
  // Nobody writes what the shards are compared with, until they are stored.
  database.BeginTransaction();
  CheckShards(options, shards);
  VerificationSummary summary;
  summary.num_deleted = database.ReadPairFingerprints().size();
  database.DeleteAllPairGeometries();
  for (const auto& shard : shards) StoreShard(*shard, &database);
  database.CommitTransaction();
  summary.totals = database.ReadPairTotals();
  return summary;
}

int RunPairGeometryMerger(int argc, char** argv) {
  PairGeometryMergerOptions options;
  CommandOptions command_options(
      "pair_geometry_merger",
      "Stores the results of all shards of depth_geometric_verifier in the "
      "database.");
  command_options.AddRequired(
      "database_path", &options.database_path, "COLMAP database");
  command_options.AddRequired(
      "shard_paths",
      &options.shard_paths,
      "files of the shards, or folders of them (*.db), separated by commas");
  BindOptions(&options, &command_options);
  if (const auto exit_code = command_options.Parse(argc, argv)) {
    return *exit_code;
  }
  const VerificationSummary summary = MergePairShards(options);
  std::cout << "merged " << summary.NumPairs() << " pairs, "
            << summary.NumValidPairs() << " valid" << std::endl;
  return 0;
}

}  // namespace dgsfm
