#include "sfm/pair_fingerprint.h"

#include "colmap_ext/fnv_hash.h"

namespace dgsfm {

namespace {

void AddImage(const Scene& scene,
              const colmap::Image& image,
              const KeypointDepthMap& depths,
              FnvHash* hash) {
  const colmap::Camera& camera = scene.cameras.at(image.CameraId());
  hash->Add(image.CameraId());
  hash->Add(camera.ModelId());
  hash->Add(camera.Width());
  hash->Add(camera.Height());
  hash->AddAll(camera.Params());
  hash->Add(camera.HasPriorFocalLength());
  const auto prior = scene.focal_priors.find(image.CameraId());
  if (prior != scene.focal_priors.end()) {
    hash->Add(prior->second.focal_px);
    hash->Add(prior->second.log_stddev);
  }
  const auto it = depths.find(image.ImageId());
  hash->Add(it != depths.end());
  if (it != depths.end()) hash->Add(it->second.focal_length_px);
}

void AddPoint(const colmap::Image& image,
              const KeypointDepthMap& depths,
              colmap::point2D_t point2D_idx,
              FnvHash* hash) {
  hash->Add(point2D_idx);
  hash->Add(image.Point2D(point2D_idx).X());
  hash->Add(image.Point2D(point2D_idx).Y());
  const auto it = depths.find(image.ImageId());
  if (it != depths.end()) hash->Add(it->second.depths.at(point2D_idx));
}

}  // namespace

uint64_t PairFingerprint(const Scene& scene,
                         const KeypointDepthMap& depths,
                         colmap::image_pair_t pair_id,
                         const colmap::FeatureMatches& matches,
                         const std::string& options_text) {
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  const colmap::Image& image1 = scene.images.at(image_id1);
  const colmap::Image& image2 = scene.images.at(image_id2);
  FnvHash hash;
  hash.AddAll(options_text);
  AddImage(scene, image1, depths, &hash);
  AddImage(scene, image2, depths, &hash);
  hash.Add(matches.size());
  for (const colmap::FeatureMatch& match : matches) {
    AddPoint(image1, depths, match.point2D_idx1, &hash);
    AddPoint(image2, depths, match.point2D_idx2, &hash);
  }
  return hash.Value();
}

}  // namespace dgsfm
