// Files with the results of one shard of the pairs of a database, on their way
// into it. depth_database.md documents them.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/pair_geometry.h"

#include <cstdint>
#include <functional>
#include <map>
#include <string>

namespace dgsfm {

// More are no parts of a database.
constexpr int kMaxNumPairShards = 1000000;

// What the results of a shard were computed by.
struct PairShardHeader {
  int shard_index = 0;
  int num_shards = 1;
  // PairMethodVersion() of the program that verified.
  uint32_t method_version = 0;
  // All options that change results.
  std::string options_text;
};

// Checks where a shard is to be written, before the work is done. Throws
// std::runtime_error, with the path, if another file than a shard or an empty
// one is there, or if the folder does not exist.
void CheckPairShardPath(const std::string& path);

// Writes a file beside its place and renames it when it is complete, so that
// its name stands for a finished shard alone. Several processes may write the
// same shard at the same time. No locks are needed. The bytes depend on the
// arguments alone. Throws std::runtime_error naming the file, as
// CheckPairShardPath too, and leaves what was there.
void WritePairShard(
    const std::string& path,
    const PairShardHeader& header,
    const std::map<colmap::image_pair_t, PairGeometry>& geometries);

// Reads such a file. All methods throw std::runtime_error with the path and the
// remedy if it is damaged or no shard.
class PairShardFile {
 public:
  explicit PairShardFile(const std::string& path);

  const std::string& Path() const { return connection_.Path(); }
  const PairShardHeader& Header() const { return header_; }

  // By increasing pair id.
  std::map<colmap::image_pair_t, uint64_t> ReadFingerprints() const;
  // Calls a function for each pair, by increasing id. That the file is whole is
  // certain in the end only.
  void ForEach(const std::function<void(colmap::image_pair_t,
                                        const PairGeometry&)>& function) const;

 private:
  // Throws an error with the remedy.
  [[noreturn]] void Fail(const std::string& problem) const;

  const SqliteConnection connection_;
  PairShardHeader header_;
  uint64_t content_hash_ = 0;
};

}  // namespace dgsfm
