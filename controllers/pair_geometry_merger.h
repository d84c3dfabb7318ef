// The controller of pair_geometry_merger: results of shards into the database.

#pragma once

#include "controllers/depth_geometric_verifier.h"

#include <string>
#include <vector>

namespace dgsfm {

struct PairGeometryMergerOptions {
  std::string database_path;
  // Files that depth_geometric_verifier --output_path wrote, or folders of
  // them, separated by commas.
  std::string shard_paths;
  int num_threads = -1;  // -1 = all cores

  bool IsValid(std::string* error) const;
};

// Binds the options that are not required.
void BindOptions(PairGeometryMergerOptions* options,
                 CommandOptions* command_options);

// The files of the paths, those of a folder sorted by name: all that end in
// ".db". Throws std::runtime_error naming a path that does not exist or a
// folder without any.
std::vector<std::string> FindShardFiles(const std::string& shard_paths);

// Replaces the pair geometries of the database by those of all its shards, in
// one transaction, after which it holds what VerifyDatabasePairs with the
// options of the shards stores. Repeated, it changes nothing.
//
// Throws std::runtime_error, and leaves the database as it was, if shards are
// missing, damaged, given twice, or differ in options, version or number, or if
// one has pairs with other matches, key points, depths or cameras than the
// database: with the names of files, or the numbers of missing shards.
VerificationSummary MergePairShards(const PairGeometryMergerOptions& options);

}  // namespace dgsfm
