#include "controllers/dense_pair_verification.h"

#include "colmap_ext/feature_cache.h"
#include "colmap_ext/keypoint_selection.h"
#include "colmap_ext/match_reader.h"
#include "colmap_ext/parallel.h"
#include "controllers/progress.h"
#include "sfm/view_graph.h"

#include <mutex>
#include <utility>

namespace dgsfm {

PairGeometries VerifyDensePairs(const DepthGeometricVerifierOptions& options,
                                const Scene& scene,
                                std::vector<StageReport>* stages) {
  StageTimer timer("pair_verification");
  const SqliteConnection connection(options.database_path,
                                    SqliteConnection::Mode::READ_ONLY);
  MatchReader reader(connection, scene);
  std::mutex reader_mutex;
  FeatureCache features(options.database_path, scene, options.use_depth);
  const auto pair_image = [&](const ImageFeatures& image) {
    return CreatePairImage(
        scene, image.image, image.depths ? &*image.depths : nullptr);
  };
  PairGeometries pairs;
  std::vector<std::pair<colmap::image_pair_t, PairGeometry*>> work;
  for (const auto& [pair_id, matches] : scene.matches) {
    work.emplace_back(pair_id, &pairs[pair_id]);
  }
  Progress progress("Verifying pairs", work.size());
  // By id, so that images are read once for many pairs.
  ParallelFor(work.size(), options.verification.num_threads, [&](size_t i) {
    const auto [pair_id, pair] = work[i];
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    colmap::FeatureMatches matches;
    {
      const std::lock_guard<std::mutex> lock(reader_mutex);
      matches = reader.Read(pair_id);
    }
    const auto image1 = features.Get(image_id1);
    const auto image2 = features.Get(image_id2);
    *pair = VerifyPair(pair_image(*image1),
                       pair_image(*image2),
                       matches,
                       options.verification);
    RestrictInliers(scene.kept_keypoints, pair_id, pair);
    pair->num_matches = scene.matches.at(pair_id).size();
    progress.Step();
  });
  timer.Add(CountPairs(pairs)).Finish(stages);
  return pairs;
}

}  // namespace dgsfm
