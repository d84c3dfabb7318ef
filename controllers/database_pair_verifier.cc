#include "controllers/database_pair_verifier.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"
#include "sfm/verification/pair_fingerprint.h"

#include <algorithm>
#include <memory>

namespace dgsfm {

DatabasePairVerifier::DatabasePairVerifier(
    const std::string& database_path,
    bool use_depth,
    const PairVerificationOptions& options,
    const std::string& options_text,
    const Scene& scene,
    const KeypointDepthMap& depths,
    SqliteConnection::Mode mode)
    : options_(options),
      options_text_(options_text),
      scene_(scene),
      depths_(depths),
      connection_(database_path, mode),
      reader_(connection_, scene) {
  if (!scene.kept_keypoints.empty()) {
    features_.emplace(database_path, scene, use_depth);
  }
}

DatabasePairVerifier::Comparison DatabasePairVerifier::Compare(
    const PairSizes& pairs, const Fingerprints& stored) {
  Comparison comparison;
  PairSizes compared;
  for (const MatchReader::PairSize& pair : pairs) {
    (stored.count(pair.pair_id) > 0 ? compared : comparison.work)
        .push_back(pair);
  }
  // Not bool, whose elements threads cannot write independently.
  std::vector<char> holds(compared.size());
  ForEach(compared,
          [&](size_t i,
              const PairImage& image1,
              const PairImage& image2,
              const colmap::FeatureMatches& matches) {
            holds[i] = stored.at(compared[i].pair_id) ==
                       PairFingerprint(image1, image2, matches, options_text_);
          });
  for (size_t i = 0; i < compared.size(); ++i) {
    if (holds[i]) {
      comparison.holding.insert(compared[i].pair_id);
    } else {
      comparison.work.push_back(compared[i]);
    }
  }
  for (const auto& [pair_id, fingerprint] : stored) {
    if (comparison.holding.count(pair_id) == 0) {
      comparison.stale.push_back(pair_id);
    }
  }
  // The largest pairs come first, so that no thread is left with one in the
  // end. A cache of features needs neighbours in the order of ids instead.
  std::sort(comparison.work.begin(),
            comparison.work.end(),
            [this](const auto& a, const auto& b) {
              return !features_ && a.num_matches != b.num_matches
                         ? a.num_matches > b.num_matches
                         : a.pair_id < b.pair_id;
            });
  return comparison;
}

void DatabasePairVerifier::Verify(const PairSizes& pairs, const Sink& sink) {
  size_t num_matches = 0;
  for (const auto& pair : pairs) num_matches += pair.num_matches;
  Progress progress("Verifying pairs", pairs.size(), num_matches);
  ForEach(pairs,
          [&](size_t i,
              const PairImage& image1,
              const PairImage& image2,
              const colmap::FeatureMatches& matches) {
            PairGeometry pair = VerifyPair(image1, image2, matches, options_);
            pair.fingerprint =
                PairFingerprint(image1, image2, matches, options_text_);
            {
              const std::lock_guard<std::mutex> lock(mutex_);
              sink(pairs[i].pair_id, std::move(pair));
            }
            progress.Step(pairs[i].num_matches);
          });
}

std::optional<KeypointDepths> DatabasePairVerifier::DepthsOf(
    const ImageFeatures& features) const {
  const colmap::image_t image_id = features.image.ImageId();
  if (!features.depths || depths_.count(image_id) == 0) return std::nullopt;
  KeypointDepths depths = *features.depths;
  const auto conversion = conversions_.find(image_id);
  if (conversion != conversions_.end()) {
    ConvertAffine(conversion->second, &depths);
  }
  return depths;
}

void DatabasePairVerifier::ForEach(const PairSizes& pairs,
                                   const Function& function) {
  ParallelFor(pairs.size(), options_.num_threads, [&](size_t i) {
    const colmap::image_pair_t pair_id = pairs[i].pair_id;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    colmap::FeatureMatches matches;
    {
      // A connection to SQLite serves one thread at a time.
      const std::lock_guard<std::mutex> lock(mutex_);
      matches = reader_.Read(pair_id);
    }
    if (!features_) {
      function(i,
               CreatePairImage(scene_, depths_, image_id1),
               CreatePairImage(scene_, depths_, image_id2),
               matches);
      return;
    }
    const auto features1 = features_->Get(image_id1);
    const auto features2 = features_->Get(image_id2);
    const auto depths1 = DepthsOf(*features1);
    const auto depths2 = DepthsOf(*features2);
    function(i,
             CreatePairImage(
                 scene_, features1->image, depths1 ? &*depths1 : nullptr),
             CreatePairImage(
                 scene_, features2->image, depths2 ? &*depths2 : nullptr),
             matches);
  });
}

}  // namespace dgsfm
