#include "sfm/view_graph/view_graph.h"

#include "colmap_ext/check.h"
#include "estimators/averaging/graph.h"

#include <algorithm>
#include <map>
#include <set>

namespace dgsfm {

namespace {

// Those of valid pairs, and all images of their frames.
std::vector<colmap::image_t> ImagesToConnect(const PairGeometries& pairs,
                                             const FrameMembers& frames) {
  std::set<colmap::image_t> image_ids;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    image_ids.insert(image_id1);
    image_ids.insert(image_id2);
  }
  std::set<frame_t> frame_ids;
  for (const colmap::image_t image_id : image_ids) {
    const auto member = frames.find(image_id);
    if (member != frames.end()) frame_ids.insert(member->second.frame_id);
  }
  for (const auto& [image_id, member] : frames) {
    if (frame_ids.count(member.frame_id) > 0) image_ids.insert(image_id);
  }
  return {image_ids.begin(), image_ids.end()};
}

}  // namespace

PairTotals CountPairs(const PairGeometries& pairs) {
  PairTotals totals;
  for (const auto& [pair_id, pair] : pairs) {
    totals.Add(pair.status, pair.degeneracies, 1);
  }
  return totals;
}

std::vector<std::vector<colmap::image_t>> ConnectedImages(
    const PairGeometries& pairs, const FrameMembers& frames) {
  const ImageIndex index(ImagesToConnect(pairs, frames));
  std::vector<GraphEdge> edges = FrameEdges(index, frames);
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    edges.emplace_back(index.Of(image_id1), index.Of(image_id2));
  }
  const std::vector<int> components = ConnectedComponents(index.Size(), edges);
  std::vector<std::vector<colmap::image_t>> images;
  for (int i = 0; i < index.Size(); ++i) {
    if (size_t(components[i]) >= images.size()) {
      images.resize(components[i] + 1);
    }
    images[components[i]].push_back(index.IdOf(i));
  }
  return images;
}

std::vector<GraphEdge> FrameEdges(const ImageIndex& index,
                                  const FrameMembers& frames) {
  std::vector<GraphEdge> edges;
  std::map<frame_t, int> first_of_frames;
  for (const auto& [image_id, member] : frames) {
    const int image = index.Of(image_id);
    if (image < 0) continue;
    const auto [first, is_new] =
        first_of_frames.emplace(member.frame_id, image);
    if (!is_new) edges.emplace_back(first->second, image);
  }
  return edges;
}

ImageIndex::ImageIndex(const std::vector<colmap::image_t>& image_ids)
    : image_ids_(image_ids) {
  DGSFM_CHECK(std::is_sorted(image_ids_.begin(), image_ids_.end()));
}

int ImageIndex::Of(colmap::image_t image_id) const {
  const auto it =
      std::lower_bound(image_ids_.begin(), image_ids_.end(), image_id);
  if (it == image_ids_.end() || *it != image_id) return -1;
  return int(it - image_ids_.begin());
}

std::vector<IndexedPair> ValidPairs(const ImageIndex& index,
                                    PairGeometries* pairs) {
  std::vector<IndexedPair> valid_pairs;
  for (auto& [pair_id, pair] : *pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const int image1 = index.Of(image_id1);
    const int image2 = index.Of(image_id2);
    if (image1 >= 0 && image2 >= 0) {
      valid_pairs.push_back({image1, image2, &pair});
    }
  }
  return valid_pairs;
}

}  // namespace dgsfm
