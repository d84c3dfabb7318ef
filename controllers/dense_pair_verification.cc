#include "controllers/dense_pair_verification.h"

#include "colmap_ext/database/feature_cache.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/match_reader.h"
#include "colmap_ext/parallel.h"
#include "controllers/progress.h"
#include "sfm/verification/pair_fingerprint.h"
#include "sfm/view_graph/view_graph.h"

#include <functional>
#include <mutex>
#include <string>
#include <utility>

namespace dgsfm {

namespace {

using Function = std::function<void(colmap::image_pair_t pair_id,
                                    const PairImage& image1,
                                    const PairImage& image2,
                                    const colmap::FeatureMatches& matches)>;

// Calls a function, from several threads, for all pairs with all matches and
// key points of the database.
void ForEachWholePair(const DepthGeometricVerifierOptions& options,
                      const Scene& scene,
                      const Function& function) {
  const SqliteConnection connection(options.database_path,
                                    SqliteConnection::Mode::READ_ONLY);
  MatchReader reader(connection, scene);
  std::mutex reader_mutex;
  FeatureCache features(options.database_path, scene, options.use_depth);
  const auto pair_image = [&](const ImageFeatures& image) {
    return CreatePairImage(
        scene, image.image, image.depths ? &*image.depths : nullptr);
  };
  std::vector<colmap::image_pair_t> pair_ids;
  for (const auto& [pair_id, matches] : scene.matches) {
    pair_ids.push_back(pair_id);
  }
  // By id, so that images are read once for many pairs.
  ParallelFor(pair_ids.size(), options.verification.num_threads, [&](size_t i) {
    const colmap::image_pair_t pair_id = pair_ids[i];
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    colmap::FeatureMatches matches;
    {
      const std::lock_guard<std::mutex> lock(reader_mutex);
      matches = reader.Read(pair_id);
    }
    const auto image1 = features.Get(image_id1);
    const auto image2 = features.Get(image_id2);
    function(pair_id, pair_image(*image1), pair_image(*image2), matches);
  });
}

}  // namespace

PairGeometries VerifyDensePairs(const DepthGeometricVerifierOptions& options,
                                const Scene& scene,
                                std::vector<StageReport>* stages) {
  StageTimer timer("pair_verification");
  PairGeometries pairs;
  for (const auto& [pair_id, matches] : scene.matches) pairs[pair_id];
  Progress progress("Verifying pairs", pairs.size());
  ForEachWholePair(options,
                   scene,
                   [&](colmap::image_pair_t pair_id,
                       const PairImage& image1,
                       const PairImage& image2,
                       const colmap::FeatureMatches& matches) {
                     PairGeometry& pair = pairs.at(pair_id);
                     pair = VerifyPair(
                         image1, image2, matches, options.verification);
                     RestrictInliers(scene.kept_keypoints, pair_id, &pair);
                     pair.num_matches = scene.matches.at(pair_id).size();
                     progress.Step();
                   });
  timer.Add(CountPairs(pairs)).Finish(stages);
  return pairs;
}

std::map<colmap::image_pair_t, uint64_t> PairFingerprints(
    const DepthGeometricVerifierOptions& options, const Scene& scene) {
  const std::string options_text = VerificationText(options.verification);
  std::map<colmap::image_pair_t, uint64_t> fingerprints;
  for (const auto& [pair_id, matches] : scene.matches) fingerprints[pair_id];
  ForEachWholePair(options,
                   scene,
                   [&](colmap::image_pair_t pair_id,
                       const PairImage& image1,
                       const PairImage& image2,
                       const colmap::FeatureMatches& matches) {
                     fingerprints.at(pair_id) =
                         PairFingerprint(image1, image2, matches, options_text);
                   });
  return fingerprints;
}

}  // namespace dgsfm
