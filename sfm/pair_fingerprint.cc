#include "sfm/pair_fingerprint.h"

#include <type_traits>

namespace dgsfm {

namespace {

class Hash {
 public:
  template <typename T>
  void Add(const T& value) {
    static_assert(std::is_arithmetic_v<T>, "padding bytes are undefined");
    AddBytes(&value, sizeof(T));
  }
  template <typename T>
  void AddAll(const T& values) {
    Add(values.size());
    for (const auto& value : values) Add(value);
  }
  uint64_t Value() const { return value_; }

 private:
  void AddBytes(const void* data, size_t num_bytes) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < num_bytes; ++i) {
      value_ = (value_ ^ bytes[i]) * 0x100000001B3ull;
    }
  }

  uint64_t value_ = 0xCBF29CE484222325ull;
};

void AddImage(const colmap::Image& image,
              const colmap::Camera& camera,
              const KeypointDepthMap& depths,
              Hash* hash) {
  hash->Add(image.CameraId());
  hash->Add(camera.ModelId());
  hash->Add(camera.Width());
  hash->Add(camera.Height());
  hash->AddAll(camera.Params());
  hash->Add(camera.HasPriorFocalLength());
  const auto it = depths.find(image.ImageId());
  hash->Add(it != depths.end());
  if (it != depths.end()) hash->Add(it->second.focal_length_px);
}

void AddPoint(const colmap::Image& image,
              const KeypointDepthMap& depths,
              colmap::point2D_t point2D_idx,
              Hash* hash) {
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
  Hash hash;
  hash.AddAll(options_text);
  AddImage(image1, scene.cameras.at(image1.CameraId()), depths, &hash);
  AddImage(image2, scene.cameras.at(image2.CameraId()), depths, &hash);
  hash.Add(matches.size());
  for (const colmap::FeatureMatch& match : matches) {
    AddPoint(image1, depths, match.point2D_idx1, &hash);
    AddPoint(image2, depths, match.point2D_idx2, &hash);
  }
  return hash.Value();
}

}  // namespace dgsfm
