#include "colmap_ext/database/feature_cache.h"

#include "colmap_ext/database/scene_database.h"

namespace dgsfm {

FeatureCache::FeatureCache(const std::string& database_path,
                           const Scene& scene,
                           bool use_depth,
                           size_t max_num_keypoints)
    : scene_(scene),
      max_num_keypoints_(max_num_keypoints),
      connection_(database_path, SqliteConnection::Mode::READ_ONLY),
      depth_database_(use_depth
                          ? std::make_optional<DepthDatabase>(
                                database_path, DepthDatabase::Mode::READ_ONLY)
                          : std::nullopt) {}

std::shared_ptr<const ImageFeatures> FeatureCache::Get(
    colmap::image_t image_id) {
  // Reading is serialized too, as a connection serves one thread at a time.
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = entries_.find(image_id);
  if (found != entries_.end()) {
    by_use_.splice(by_use_.begin(), by_use_, found->second.position);
    return found->second.features;
  }
  std::shared_ptr<const ImageFeatures> features = Read(image_id);
  // The features may be larger than the cache: they are handed out all the
  // same.
  MakeRoomFor(features->image.NumPoints2D());
  by_use_.push_front(image_id);
  entries_[image_id] = {features, by_use_.begin()};
  num_keypoints_ += features->image.NumPoints2D();
  return features;
}

std::shared_ptr<const ImageFeatures> FeatureCache::Read(
    colmap::image_t image_id) const {
  auto features = std::make_shared<ImageFeatures>();
  const colmap::Image& image = scene_.images.at(image_id);
  features->image.SetImageId(image_id);
  features->image.SetName(image.Name());
  features->image.SetCameraId(image.CameraId());
  features->image.SetPoints2D(ReadKeypoints(connection_, image));
  if (depth_database_) {
    features->depths = depth_database_->ReadKeypointDepths(image_id);
  }
  return features;
}

void FeatureCache::MakeRoomFor(size_t num_keypoints) {
  while (!by_use_.empty() &&
         num_keypoints_ + num_keypoints > max_num_keypoints_) {
    const auto last = entries_.find(by_use_.back());
    num_keypoints_ -= last->second.features->image.NumPoints2D();
    entries_.erase(last);
    by_use_.pop_back();
  }
}

}  // namespace dgsfm
