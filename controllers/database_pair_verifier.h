// Verification of the pairs of a database: the one way, for sparse and dense
// matches, of depth_geometric_verifier and depth_global_mapper.

#pragma once

#include "colmap_ext/database/feature_cache.h"
#include "colmap_ext/database/match_reader.h"
#include "colmap_ext/depth/affine_depth.h"
#include "sfm/verification/pair_verification.h"

#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// Matches are read pair by pair, so that those of a pair are in memory only
// while it is verified. Where a scene keeps some key points only, pairs are
// verified by all of them, which are read when they are needed.
class DatabasePairVerifier {
 public:
  using PairSizes = std::vector<MatchReader::PairSize>;
  using Fingerprints = std::map<colmap::image_pair_t, uint64_t>;
  // Takes over a finished pair. Called by one thread at a time, in no
  // particular order. Where the scene has all key points, nothing is read from
  // the database meanwhile, so that it may be written.
  using Sink = std::function<void(colmap::image_pair_t, PairGeometry)>;

  // What is stored of pairs of a database.
  struct Comparison {
    // Pairs whose stored result holds: it has the fingerprint of what the
    // pair would be verified from now, which is matches, key points, depths,
    // cameras, options and version of the estimator.
    std::set<colmap::image_pair_t> holding;
    // The other pairs. Long ones come first where all key points are in memory:
    // at the end they would leave other threads without work. Otherwise pairs
    // are ordered by id, so that key points are read once for many pairs.
    PairSizes work;
    // Stored results that do not hold, by id.
    std::vector<colmap::image_pair_t> stale;
  };

  // Scene and depths must outlive this. `options_text` has the options that
  // change results. The database is only read.
  DatabasePairVerifier(const std::string& database_path,
                       bool use_depth,
                       const PairVerificationOptions& options,
                       const std::string& options_text,
                       const Scene& scene,
                       const KeypointDepthMap& depths,
                       SqliteConnection::Mode mode);

  // By what affine maps became `depths`, for key points that the scene lacks.
  void SetConversions(AffineDepths conversions) {
    conversions_ = std::move(conversions);
  }

  // All pairs of the database by id. Throws std::runtime_error as MatchReader.
  PairSizes ListPairs() const { return reader_.ListPairs(); }

  // Compares pairs with what is stored. Throws as above.
  Comparison Compare(const PairSizes& pairs, const Fingerprints& stored);

  // Verifies pairs, and shows the progress. Geometries have their fingerprint.
  void Verify(const PairSizes& pairs, const Sink& sink);

 private:
  using Function = std::function<void(size_t i,
                                      const PairImage& image1,
                                      const PairImage& image2,
                                      const colmap::FeatureMatches& matches)>;

  // Calls a function for each pair, from several threads.
  void ForEach(const PairSizes& pairs, const Function& function);

  // All depths of an image that is in depths_, converted as these are.
  std::optional<KeypointDepths> DepthsOf(const ImageFeatures& features) const;

  const PairVerificationOptions& options_;
  const std::string options_text_;
  const Scene& scene_;
  const KeypointDepthMap& depths_;
  AffineDepths conversions_;
  const SqliteConnection connection_;
  // Where the scene lacks key points.
  std::optional<FeatureCache> features_;
  // Guards the reader, and calls of sinks.
  std::mutex mutex_;
  MatchReader reader_;
};

}  // namespace dgsfm
