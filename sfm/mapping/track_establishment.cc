#include "sfm/mapping/track_establishment.h"

#include "estimators/option_check.h"

#include <algorithm>
#include <numeric>
#include <unordered_map>

namespace dgsfm {

namespace {

// Union-find over the features that occur in matches. Each set lists its
// features by image, so that a union with two features of one image is refused.
class FeatureSets {
 public:
  struct Feature {
    int image;
    colmap::point2D_t point2D_idx;
    bool operator<(const Feature& other) const {
      return std::tie(image, point2D_idx) <
             std::tie(other.image, other.point2D_idx);
    }
  };

  int IdOf(const Feature& feature) {
    const uint64_t key =
        (uint64_t(uint32_t(feature.image)) << 32) | feature.point2D_idx;
    const auto [it, is_new] = ids_.emplace(key, int(parents_.size()));
    if (is_new) {
      parents_.push_back(it->second);
      members_.push_back({feature});
    }
    return it->second;
  }

  void UnionIfConsistent(int id1, int id2) {
    int root1 = Find(id1);
    int root2 = Find(id2);
    if (root1 == root2) return;
    if (members_[root1].size() < members_[root2].size()) {
      std::swap(root1, root2);
    }
    std::vector<Feature> merged;
    merged.reserve(members_[root1].size() + members_[root2].size());
    std::merge(members_[root1].begin(),
               members_[root1].end(),
               members_[root2].begin(),
               members_[root2].end(),
               std::back_inserter(merged));
    for (size_t i = 1; i < merged.size(); ++i) {
      if (merged[i].image == merged[i - 1].image) return;
    }
    members_[root1] = std::move(merged);
    members_[root2] = {};
    parents_[root2] = root1;
  }

  // Non-empty sets, each ordered by image.
  const std::vector<std::vector<Feature>>& Members() const { return members_; }

 private:
  int Find(int id) {
    while (parents_[id] != id) id = parents_[id] = parents_[parents_[id]];
    return id;
  }

  std::unordered_map<uint64_t, int> ids_;
  std::vector<int> parents_;
  std::vector<std::vector<Feature>> members_;
};

using FeatureSet = std::vector<FeatureSets::Feature>;

std::vector<FeatureSet> JoinMatches(const ImageIndex& index,
                                    const PairGeometries& pairs) {
  std::vector<std::pair<colmap::image_pair_t, const PairGeometry*>> ordered;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status == PairStatus::VALID) ordered.emplace_back(pair_id, &pair);
  }
  std::stable_sort(
      ordered.begin(), ordered.end(), [](const auto& a, const auto& b) {
        return a.second->inlier_matches.size() >
               b.second->inlier_matches.size();
      });
  FeatureSets sets;
  for (const auto& [pair_id, pair] : ordered) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const int image1 = index.Of(image_id1);
    const int image2 = index.Of(image_id2);
    if (image1 < 0 || image2 < 0) continue;
    for (const colmap::FeatureMatch& match : pair->inlier_matches) {
      const int id1 = sets.IdOf({image1, match.point2D_idx1});
      const int id2 = sets.IdOf({image2, match.point2D_idx2});
      sets.UnionIfConsistent(id1, id2);
    }
  }
  std::vector<FeatureSet> joined;
  for (const FeatureSet& members : sets.Members()) {
    if (members.size() >= 2) joined.push_back(members);
  }
  std::sort(joined.begin(), joined.end());
  return joined;
}

}  // namespace

bool TrackOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("min_num_views_per_track", min_num_views_per_track, 2)
      .AtLeast("min_num_tracks_per_view", min_num_tracks_per_view, 0)
      .AreKept();
}

std::vector<colmap::Track> EstablishTracks(const ImageIndex& index,
                                           const PairGeometries& pairs,
                                           const TrackOptions& options) {
  const std::vector<FeatureSet> joined = JoinMatches(index, pairs);
  std::vector<int> num_tracks(index.Size(), 0);
  for (const FeatureSet& set : joined) {
    if (set.size() < size_t(options.min_num_views_per_track)) continue;
    for (const auto& feature : set) ++num_tracks[feature.image];
  }
  const auto is_short_of_tracks = [&](const FeatureSets::Feature& feature) {
    return num_tracks[feature.image] < options.min_num_tracks_per_view;
  };
  std::vector<colmap::Track> tracks;
  for (const FeatureSet& set : joined) {
    if (set.size() < size_t(options.min_num_views_per_track) &&
        std::none_of(set.begin(), set.end(), is_short_of_tracks)) {
      continue;
    }
    colmap::Track track;
    track.Reserve(set.size());
    for (const auto& feature : set) {
      track.AddElement(index.IdOf(feature.image), feature.point2D_idx);
    }
    tracks.push_back(std::move(track));
  }
  return tracks;
}

}  // namespace dgsfm
