#include "sfm/mapping/track_establishment.h"

#include "estimators/option_check.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace dgsfm {

namespace {

// Union-find over the features of all images, numbered image by image. Each set
// lists its features in this order, so that a union with two features of one
// image is refused.
class FeatureSets {
 public:
  // The images of the features and how many each has.
  explicit FeatureSets(const std::vector<size_t>& num_features) {
    if (std::accumulate(num_features.begin(), num_features.end(), size_t(0)) >
        size_t(std::numeric_limits<int>::max())) {
      throw std::runtime_error(
          "the images have more than 2^31 key points: use fewer of each "
          "(--max_num_keypoints_per_image), or map fewer images at a time");
    }
    for (size_t image = 0; image < num_features.size(); ++image) {
      begin_.push_back(int(images_.size()));
      images_.insert(images_.end(), num_features[image], int(image));
    }
    parents_.resize(images_.size());
    std::iota(parents_.begin(), parents_.end(), 0);
    first_ = parents_;
    next_.assign(images_.size(), -1);
    sizes_.assign(images_.size(), 1);
  }

  int IdOf(int image, colmap::point2D_t point2D_idx) const {
    return begin_[image] + int(point2D_idx);
  }
  int ImageOf(int id) const { return images_[id]; }
  colmap::point2D_t PointOf(int id) const {
    return colmap::point2D_t(id - begin_[images_[id]]);
  }
  int NumFeatures() const { return int(images_.size()); }
  // Number of features of the set whose first one this is, else 0.
  int SizeFrom(int id) {
    const int root = Find(id);
    return first_[root] == id ? sizes_[root] : 0;
  }
  // The feature behind this one in its set, or -1.
  int Next(int id) const { return next_[id]; }

  void UnionIfConsistent(int id1, int id2) {
    int root1 = Find(id1);
    int root2 = Find(id2);
    if (root1 == root2 || ShareAnImage(root1, root2)) return;
    if (sizes_[root1] < sizes_[root2]) std::swap(root1, root2);
    int head = -1;
    int* link = &head;
    for (int a = first_[root1], b = first_[root2]; a >= 0 || b >= 0;) {
      int& from = b < 0 || (a >= 0 && a < b) ? a : b;
      *link = from;
      link = &next_[from];
      from = *link;
    }
    first_[root1] = head;
    sizes_[root1] += sizes_[root2];
    parents_[root2] = root1;
  }

 private:
  int Find(int id) {
    while (parents_[id] != id) id = parents_[id] = parents_[parents_[id]];
    return id;
  }

  bool ShareAnImage(int root1, int root2) const {
    int a = first_[root1], b = first_[root2];
    while (a >= 0 && b >= 0) {
      if (images_[a] == images_[b]) return true;
      int& earlier = a < b ? a : b;
      earlier = next_[earlier];
    }
    return false;
  }

  // First feature of each image.
  std::vector<int> begin_;
  // Image and parent of each feature, and the next feature of its set.
  std::vector<int> images_;
  std::vector<int> parents_;
  std::vector<int> next_;
  // First feature and number of features in the set of each root.
  std::vector<int> first_;
  std::vector<int> sizes_;
};

FeatureSets JoinMatches(const ImageIndex& index, const PairGeometries& pairs) {
  struct IndexedMatches {
    int image1;
    int image2;
    const colmap::FeatureMatches* matches;
  };
  std::vector<IndexedMatches> ordered;
  std::vector<size_t> num_features(index.Size(), 0);
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const int image1 = index.Of(image_id1);
    const int image2 = index.Of(image_id2);
    if (pair.status != PairStatus::VALID || image1 < 0 || image2 < 0) continue;
    ordered.push_back({image1, image2, &pair.inlier_matches});
    for (const colmap::FeatureMatch& match : pair.inlier_matches) {
      num_features[image1] =
          std::max<size_t>(num_features[image1], match.point2D_idx1 + 1);
      num_features[image2] =
          std::max<size_t>(num_features[image2], match.point2D_idx2 + 1);
    }
  }
  std::stable_sort(
      ordered.begin(), ordered.end(), [](const auto& a, const auto& b) {
        return a.matches->size() > b.matches->size();
      });
  FeatureSets sets(num_features);
  for (const IndexedMatches& pair : ordered) {
    for (const colmap::FeatureMatch& match : *pair.matches) {
      sets.UnionIfConsistent(sets.IdOf(pair.image1, match.point2D_idx1),
                             sets.IdOf(pair.image2, match.point2D_idx2));
    }
  }
  return sets;
}

}  // namespace

bool TrackOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("min_num_views_per_track", min_num_views_per_track, 2)
      .AtLeast("min_num_tracks_per_view", min_num_tracks_per_view, 0)
      .AtLeast("max_num_tracks", max_num_tracks, 0)
      .AtLeast(
          "max_num_observations_per_image", max_num_observations_per_image, 0)
      .AtLeast("max_num_start_observations_per_image",
               max_num_start_observations_per_image,
               0)
      .AtLeast(
          "min_num_images_to_bound_start", min_num_images_to_bound_start, 0)
      .AreKept();
}

std::vector<colmap::Track> EstablishTracks(const ImageIndex& index,
                                           const PairGeometries& pairs,
                                           const TrackOptions& options) {
  FeatureSets sets = JoinMatches(index, pairs);
  std::vector<int> num_tracks(index.Size(), 0);
  for (int id = 0; id < sets.NumFeatures(); ++id) {
    if (sets.SizeFrom(id) < options.min_num_views_per_track) continue;
    for (int i = id; i >= 0; i = sets.Next(i)) ++num_tracks[sets.ImageOf(i)];
  }
  const auto is_wanted = [&](int first, int size) {
    if (size >= options.min_num_views_per_track) return true;
    for (int i = first; size >= 2 && i >= 0; i = sets.Next(i)) {
      if (num_tracks[sets.ImageOf(i)] < options.min_num_tracks_per_view) {
        return true;
      }
    }
    return false;
  };
  std::vector<colmap::Track> tracks;
  for (int id = 0; id < sets.NumFeatures(); ++id) {
    const int size = sets.SizeFrom(id);
    if (!is_wanted(id, size)) continue;
    colmap::Track& track = tracks.emplace_back();
    track.Reserve(size_t(size));
    for (int i = id; i >= 0; i = sets.Next(i)) {
      track.AddElement(index.IdOf(sets.ImageOf(i)), sets.PointOf(i));
    }
  }
  return tracks;
}

}  // namespace dgsfm
