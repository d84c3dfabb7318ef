#include "colmap_ext/database/keypoint_selection.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/match_reader.h"
#include "colmap_ext/database/scene_database.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

namespace dgsfm {
namespace {

// Parts of an image along each side.
constexpr int kGridSize = 16;

// The part of the image that each point lies in.
std::vector<int> CellsOf(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Array2d min = Eigen::Array2d::Constant(HUGE_VAL);
  Eigen::Array2d max = -min;
  for (const Eigen::Vector2d& point : points) {
    min = min.min(point.array());
    max = max.max(point.array());
  }
  // Not zero, where all points are one.
  const Eigen::Array2d size = (max - min).max(1e-9);
  std::vector<int> cells;
  for (const Eigen::Vector2d& point : points) {
    const Eigen::Array2i cell = (kGridSize * (point.array() - min) / size)
                                    .cast<int>()
                                    .min(kGridSize - 1);
    cells.push_back(cell.y() * kGridSize + cell.x());
  }
  return cells;
}

// The key points in the order in which a pair gives them.
std::vector<colmap::point2D_t> OrderToGive(
    std::vector<colmap::point2D_t> indices,
    const std::vector<int>& cells,
    const std::vector<int>& num_matches) {
  // Ties are broken by the index, so that the order is the same everywhere.
  std::sort(indices.begin(), indices.end(), [&](auto a, auto b) {
    return num_matches[a] != num_matches[b] ? num_matches[a] > num_matches[b]
                                            : a < b;
  });
  // The best one of each part comes first, then the second best of each, ...
  std::vector<int> num_in_cell(kGridSize * kGridSize, 0);
  std::vector<std::pair<int, colmap::point2D_t>> ranked;
  for (const colmap::point2D_t i : indices) {
    ranked.emplace_back(num_in_cell[cells[i]]++, i);
  }
  std::stable_sort(ranked.begin(), ranked.end(), [](auto a, auto b) {
    return a.first < b.first;
  });
  for (size_t i = 0; i < ranked.size(); ++i) indices[i] = ranked[i].second;
  return indices;
}

// Images of the scene with more key points than are to be used, by id.
std::vector<colmap::image_t> ImagesWithManyKeypoints(
    const SqliteConnection& connection,
    const Scene& scene,
    size_t max_num_keypoints) {
  SqliteStatement select(
      connection,
      "SELECT image_id FROM keypoints JOIN images "
      "USING (image_id) WHERE rows > ? ORDER BY image_id",
      std::min<size_t>(max_num_keypoints, std::numeric_limits<int>::max()));
  std::vector<colmap::image_t> image_ids;
  while (select.Step()) {
    const auto image_id = static_cast<colmap::image_t>(select.Int(0));
    if (scene.images.count(image_id) > 0) image_ids.push_back(image_id);
  }
  return image_ids;
}

std::vector<ImageMatches> MatchesOfImage(
    colmap::image_t image_id,
    const std::vector<colmap::image_pair_t>& pair_ids,
    MatchReader* reader) {
  std::vector<ImageMatches> all_matches;
  for (const colmap::image_pair_t pair_id : pair_ids) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    ImageMatches matches;
    matches.other_image_id = image_id == image_id1 ? image_id2 : image_id1;
    for (const colmap::FeatureMatch& match : reader->Read(pair_id)) {
      matches.own.push_back(match.point2D_idx1);
      matches.other.push_back(match.point2D_idx2);
    }
    if (image_id == image_id2) std::swap(matches.own, matches.other);
    all_matches.push_back(std::move(matches));
  }
  return all_matches;
}

// Key points without a match cost nothing, so only matched ones count.
size_t NumMatchedKeypoints(const std::vector<ImageMatches>& all_matches,
                           size_t num_keypoints) {
  std::vector<char> is_matched(num_keypoints, 0);
  for (const ImageMatches& matches : all_matches) {
    for (const colmap::point2D_t i : matches.own) is_matched.at(i) = 1;
  }
  return std::count(is_matched.begin(), is_matched.end(), 1);
}

// What of an image and of others is kept when these key points of it are.
void AddChosen(colmap::image_t image_id,
               const std::vector<colmap::point2D_t>& chosen,
               const std::vector<ImageMatches>& all_matches,
               KeptKeypoints* kept) {
  auto& indices = (*kept)[image_id];
  indices.insert(indices.end(), chosen.begin(), chosen.end());
  for (const ImageMatches& matches : all_matches) {
    auto& other_indices = (*kept)[matches.other_image_id];
    for (size_t i = 0; i < matches.own.size(); ++i) {
      if (std::binary_search(chosen.begin(), chosen.end(), matches.own[i])) {
        other_indices.push_back(matches.other[i]);
      }
    }
  }
}

// The number of a key point among those that are kept.
std::optional<colmap::point2D_t> NewIndex(
    const std::vector<colmap::point2D_t>* kept, colmap::point2D_t index) {
  if (kept == nullptr) return index;
  const auto it = std::lower_bound(kept->begin(), kept->end(), index);
  if (it == kept->end() || *it != index) return std::nullopt;
  return static_cast<colmap::point2D_t>(it - kept->begin());
}

}  // namespace

std::vector<colmap::point2D_t> ChooseKeypoints(
    const std::vector<Eigen::Vector2d>& points,
    const std::vector<ImageMatches>& matches,
    size_t max_num_matches) {
  std::vector<int> num_matches(points.size(), 0);
  for (const ImageMatches& pair : matches) {
    DGSFM_CHECK(pair.own.size() == pair.other.size());
    for (const colmap::point2D_t i : pair.own) ++num_matches.at(i);
  }
  const std::vector<int> cells = CellsOf(points);
  std::vector<std::vector<colmap::point2D_t>> offers;
  for (const ImageMatches& pair : matches) {
    offers.push_back(OrderToGive(pair.own, cells, num_matches));
  }
  std::vector<char> is_chosen(points.size(), 0);
  std::vector<size_t> next(offers.size(), 0);
  size_t num_chosen_matches = 0;
  for (bool is_any_left = true; is_any_left;) {
    is_any_left = false;
    for (size_t k = 0; k < offers.size(); ++k) {
      while (next[k] < offers[k].size() && is_chosen[offers[k][next[k]]]) {
        ++next[k];
      }
      if (next[k] == offers[k].size() ||
          num_chosen_matches >= max_num_matches) {
        continue;
      }
      is_chosen[offers[k][next[k]]] = 1;
      num_chosen_matches += num_matches[offers[k][next[k]]];
      is_any_left = true;
    }
  }
  std::vector<colmap::point2D_t> chosen;
  for (size_t i = 0; i < points.size(); ++i) {
    if (is_chosen[i]) chosen.push_back(static_cast<colmap::point2D_t>(i));
  }
  return chosen;
}

KeptKeypoints SelectKeypoints(const SqliteConnection& connection,
                              const Scene& scene,
                              size_t max_num_keypoints) {
  const std::vector<colmap::image_t> image_ids =
      ImagesWithManyKeypoints(connection, scene, max_num_keypoints);
  if (image_ids.empty()) return {};
  MatchReader reader(connection, scene);
  std::map<colmap::image_t, std::vector<colmap::image_pair_t>> pairs;
  for (const MatchReader::PairSize& pair : reader.ListPairs()) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair.pair_id);
    pairs[image_id1].push_back(pair.pair_id);
    pairs[image_id2].push_back(pair.pair_id);
  }
  KeptKeypoints all_kept;
  // Choices in other images have added key points to images that are not
  // restricted; these keep all of theirs.
  std::vector<colmap::image_t> restricted_ids;
  for (const colmap::image_t image_id : image_ids) {
    const auto points = ReadKeypoints(connection, scene.images.at(image_id));
    const auto matches = MatchesOfImage(image_id, pairs[image_id], &reader);
    if (NumMatchedKeypoints(matches, points.size()) <= max_num_keypoints) {
      continue;
    }
    AddChosen(image_id,
              ChooseKeypoints(points, matches, max_num_keypoints / 2),
              matches,
              &all_kept);
    restricted_ids.push_back(image_id);
  }
  KeptKeypoints kept;
  for (const colmap::image_t image_id : restricted_ids) {
    std::vector<colmap::point2D_t>& indices = kept[image_id];
    indices = std::move(all_kept[image_id]);
    std::sort(indices.begin(), indices.end());
    indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
    indices.shrink_to_fit();
  }
  return kept;
}

std::vector<size_t> RestrictMatches(const KeptKeypoints& kept,
                                    colmap::image_pair_t pair_id,
                                    colmap::FeatureMatches* matches) {
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  const auto kept_of = [&](colmap::image_t image_id) {
    const auto it = kept.find(image_id);
    return it == kept.end() ? nullptr : &it->second;
  };
  const auto* kept1 = kept_of(image_id1);
  const auto* kept2 = kept_of(image_id2);
  std::vector<size_t> origins;
  colmap::FeatureMatches restricted;
  for (size_t i = 0; i < matches->size(); ++i) {
    const auto index1 = NewIndex(kept1, (*matches)[i].point2D_idx1);
    const auto index2 = NewIndex(kept2, (*matches)[i].point2D_idx2);
    if (!index1 || !index2) continue;
    restricted.emplace_back(*index1, *index2);
    origins.push_back(i);
  }
  // Few of the matches may be left, and all pairs stay in memory.
  restricted.shrink_to_fit();
  *matches = std::move(restricted);
  return origins;
}

void RestrictInliers(const KeptKeypoints& kept,
                     colmap::image_pair_t pair_id,
                     PairGeometry* geometry) {
  std::vector<uint8_t> depth_verified;
  for (const size_t i :
       RestrictMatches(kept, pair_id, &geometry->inlier_matches)) {
    depth_verified.push_back(geometry->depth_verified[i]);
  }
  geometry->depth_verified = std::move(depth_verified);
}

}  // namespace dgsfm
