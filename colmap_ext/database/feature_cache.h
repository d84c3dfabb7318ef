// Key points of images and their depths, read when they are needed, so that
// memory need not grow with the number of images.

#pragma once

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/scene.h"

#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

namespace dgsfm {

struct ImageFeatures {
  // With its key points as Points2D.
  colmap::Image image;
  // Nothing without a depth map.
  std::optional<KeypointDepths> depths;
};

// Thread-safe.
class FeatureCache {
 public:
  // Some 28 bytes each.
  static constexpr size_t kMaxNumKeypoints = 5'000'000;

  // The scene holds the images of the database and must outlive the cache.
  // Images used last stay in memory as long as these and the new one have at
  // most max_num_keypoints together.
  FeatureCache(const std::string& database_path,
               const Scene& scene,
               bool use_depth,
               size_t max_num_keypoints = kMaxNumKeypoints);

  // Throws std::runtime_error as ReadScene and DepthDatabase do.
  std::shared_ptr<const ImageFeatures> Get(colmap::image_t image_id);

 private:
  struct Entry {
    std::shared_ptr<const ImageFeatures> features;
    std::list<colmap::image_t>::iterator position;
  };

  std::shared_ptr<const ImageFeatures> Read(colmap::image_t image_id) const;
  void MakeRoomFor(size_t num_keypoints);

  const Scene& scene_;
  const size_t max_num_keypoints_;
  const SqliteConnection connection_;
  const std::optional<DepthDatabase> depth_database_;

  // Guards all of it.
  std::mutex mutex_;
  std::map<colmap::image_t, Entry> entries_;
  // Used last come first.
  std::list<colmap::image_t> by_use_;
  size_t num_keypoints_ = 0;
};

}  // namespace dgsfm
