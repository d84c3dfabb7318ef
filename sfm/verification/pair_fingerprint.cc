#include "sfm/verification/pair_fingerprint.h"

#include "colmap_ext/fnv_hash.h"

namespace dgsfm {

namespace {

// To be raised whenever VerifyPair() gives another result for the same pair:
// what an earlier version of the program has stored does not hold any more.
constexpr uint32_t kVersion = 13;

void AddImage(const PairImage& image, FnvHash* hash) {
  hash->Add(image.image.CameraId());
  hash->Add(image.camera.ModelId());
  hash->Add(image.camera.Width());
  hash->Add(image.camera.Height());
  hash->AddAll(image.camera.Params());
  hash->Add(image.camera.HasPriorFocalLength());
  hash->Add(image.focal_prior.focal_px);
  hash->Add(image.focal_prior.log_stddev);
  hash->Add(image.depths != nullptr);
  if (image.depths != nullptr) hash->Add(image.depths->focal_length_px);
}

// Only matched key points count: others do not change the result.
void AddPoint(const PairImage& image,
              colmap::point2D_t point2D_idx,
              FnvHash* hash) {
  hash->Add(point2D_idx);
  hash->Add(image.image.Point2D(point2D_idx).X());
  hash->Add(image.image.Point2D(point2D_idx).Y());
  if (image.depths != nullptr) {
    hash->Add(image.depths->depths.at(point2D_idx));
  }
}

}  // namespace

uint32_t PairMethodVersion() { return kVersion; }

uint64_t PairFingerprint(const PairImage& image1,
                         const PairImage& image2,
                         const colmap::FeatureMatches& matches,
                         const std::string& options_text) {
  FnvHash hash;
  hash.Add(kVersion);
  hash.AddAll(options_text);
  AddImage(image1, &hash);
  AddImage(image2, &hash);
  hash.Add(matches.size());
  for (const colmap::FeatureMatch& match : matches) {
    AddPoint(image1, match.point2D_idx1, &hash);
    AddPoint(image2, match.point2D_idx2, &hash);
  }
  return hash.Value();
}

}  // namespace dgsfm
