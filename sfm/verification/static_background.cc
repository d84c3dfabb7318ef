#include "sfm/verification/static_background.h"

#include "estimators/averaging/graph.h"
#include "sfm/view_graph/view_graph.h"

#include <set>

namespace dgsfm {

namespace {

constexpr size_t kMinNumImages = 3;
constexpr int kMinNumStaticMatches = 2;

// Components of the graph whose edges are the stationary pairs.
std::vector<std::vector<colmap::image_t>> ConnectedByStationaryPairs(
    const PairGeometries& pairs) {
  PairGeometries stationary;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::STATIONARY) continue;
    stationary[pair_id].status = PairStatus::VALID;
  }
  return ConnectedImages(stationary);
}

// Static less moving matches, and static ones, of a key point.
struct Votes {
  int excess = 0;
  int num_static = 0;
};

void Count(bool is_static, Votes* votes) {
  votes->excess += is_static ? 1 : -1;
  votes->num_static += is_static;
}

// All matches within the group vote, those of valid pairs too: a moving point
// may be matched in a stationary pair by chance.
StaticKeypoints FindInGroup(const Scene& scene,
                            const std::vector<colmap::image_t>& image_ids,
                            double max_motion_px) {
  std::map<colmap::image_t, std::vector<Votes>> votes;
  for (const colmap::image_t image_id : image_ids) {
    votes[image_id].resize(scene.images.at(image_id).NumPoints2D());
  }
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto votes1 = votes.find(image_id1);
    const auto votes2 = votes.find(image_id2);
    if (votes1 == votes.end() || votes2 == votes.end()) continue;
    const colmap::Image& image1 = scene.images.at(image_id1);
    const colmap::Image& image2 = scene.images.at(image_id2);
    for (const auto& [idx1, idx2] : matches) {
      const double motion =
          (image1.Point2D(idx1).XY() - image2.Point2D(idx2).XY()).norm();
      Count(motion <= max_motion_px, &votes1->second[idx1]);
      Count(motion <= max_motion_px, &votes2->second[idx2]);
    }
  }
  StaticKeypoints keypoints;
  keypoints.image_ids = image_ids;
  for (const auto& [image_id, image_votes] : votes) {
    std::vector<char>& is_static = keypoints.is_static[image_id];
    for (const Votes& v : image_votes) {
      is_static.push_back(v.num_static >= kMinNumStaticMatches && v.excess > 0);
    }
  }
  return keypoints;
}

}  // namespace

bool StaticKeypoints::Contains(colmap::image_t image_id,
                               colmap::point2D_t point2D_idx) const {
  const auto it = is_static.find(image_id);
  return it != is_static.end() && it->second.at(point2D_idx);
}

std::vector<StaticKeypoints> FindStaticKeypoints(const Scene& scene,
                                                 const PairGeometries& pairs,
                                                 double max_motion_px) {
  std::vector<StaticKeypoints> groups;
  for (const auto& image_ids : ConnectedByStationaryPairs(pairs)) {
    if (image_ids.size() < kMinNumImages) continue;
    groups.push_back(FindInGroup(scene, image_ids, max_motion_px));
  }
  return groups;
}

std::map<colmap::image_pair_t, colmap::FeatureMatches> MatchesThatMove(
    const Scene& scene, const StaticKeypoints& keypoints) {
  std::map<colmap::image_pair_t, colmap::FeatureMatches> moving;
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    colmap::FeatureMatches left;
    for (const colmap::FeatureMatch& match : matches) {
      if (!keypoints.Contains(image_id1, match.point2D_idx1) &&
          !keypoints.Contains(image_id2, match.point2D_idx2)) {
        left.push_back(match);
      }
    }
    // Unchanged pairs need no second verification.
    if (left.size() < matches.size()) moving[pair_id] = std::move(left);
  }
  return moving;
}

size_t CountMovingPairs(const PairGeometries& pairs) {
  size_t num_pairs = 0;
  for (const auto& [pair_id, pair] : pairs) {
    num_pairs += pair.status == PairStatus::VALID &&
                 !pair.Has(PairDegeneracy::ROTATION_ONLY);
  }
  return num_pairs;
}

}  // namespace dgsfm
