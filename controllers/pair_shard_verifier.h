// Verification of a part of the pairs of a database, by many processes on many
// machines, each with a file as its result.

#pragma once

#include "colmap_ext/database/pair_shard_file.h"
#include "controllers/depth_geometric_verifier.h"

#include <string>

namespace dgsfm {

// Options of verification and input that change results, and back. Throws
// std::runtime_error naming what is damaged.
std::string ShardOptionsText(const DepthGeometricVerifierOptions& options);
DepthGeometricVerifierOptions OptionsOfShard(const std::string& options_text);

// Shard shard_index of num_shards: the pairs are cut by id into ranges of about
// as many matches each, so that few images have pairs in several shards. A pair
// is in the range that the middle of its matches is in.
DatabasePairVerifier::PairSizes PairsOfShard(
    const DatabasePairVerifier::PairSizes& pairs,
    int shard_index,
    int num_shards);

// What pairs are verified from: the images of all, and key points and depths of
// those that have such a pair.
struct ShardInput {
  Scene scene;
  KeypointDepthMap depths;
  AffineDepths conversions;
};

// Reads the input of some pairs of a database. `scene` has all its images
// without key points, see ReadShardScene. Maps of unknown scale and shift among
// the depths take all of the database into memory, as their conversion does.
ShardInput ReadShardInput(const DepthGeometricVerifierOptions& options,
                          const Scene& scene,
                          const DatabasePairVerifier::PairSizes& pairs);

// The images and cameras of the database, and its pairs by id.
Scene ReadShardScene(const DepthGeometricVerifierOptions& options);
DatabasePairVerifier::PairSizes ListPairs(
    const DepthGeometricVerifierOptions& options, const Scene& scene);

// Verifies a shard of the pairs with depth and writes the result to its file,
// for MergePairShards. A file that holds the result of the same input already
// stays, and what the database holds already is taken over. Geometries are
// those that VerifyDatabasePairs stores. The database is opened without locks
// and not written.
//
// Throws std::runtime_error on unusable input, if the database was written
// meanwhile, and Cancelled; the file is then as before.
VerificationSummary VerifyPairShard(
    const DepthGeometricVerifierOptions& options);

}  // namespace dgsfm
