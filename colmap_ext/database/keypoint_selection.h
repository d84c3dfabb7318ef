// Which key points of an image with very many are used: dense matchers give
// each pair thousands of its own.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/pair_geometry.h"
#include "colmap_ext/scene.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// The matches of an image and another one.
struct ImageMatches {
  colmap::image_t other_image_id = 0;
  // Key points of the image, and of the other, same length.
  std::vector<colmap::point2D_t> own;
  std::vector<colmap::point2D_t> other;
};

// Chooses key points of an image, given the position of each, that have
// max_num_matches matches together, or a few more: in turns one for each pair,
// so that weak pairs keep what they have. Each pair gives those first that
// spread over the image, and in each of its 16 x 16 parts those that most pairs
// match. Deterministic; in increasing order.
std::vector<colmap::point2D_t> ChooseKeypoints(
    const std::vector<Eigen::Vector2d>& points,
    const std::vector<ImageMatches>& matches,
    size_t max_num_matches);

// Chooses key points of each image of which more than max_num_keypoints are
// matched: those that ChooseKeypoints takes for half as many matches, and those
// that key points chosen in other images are matched with, so that an image has
// about max_num_keypoints and all images together at most that many each. Only
// these images have an entry. The scene holds the images of the database;
// memory grows with the matches of one image. Throws as MatchReader.
KeptKeypoints SelectKeypoints(const SqliteConnection& connection,
                              const Scene& scene,
                              size_t max_num_keypoints);

// The matches between key points that are kept, renumbered to count these
// alone. The indices of them are returned, those of `matches` they came from.
std::vector<size_t> RestrictMatches(const KeptKeypoints& kept,
                                    colmap::image_pair_t pair_id,
                                    colmap::FeatureMatches* matches);

// The same for the inliers of a geometry, whose number of matches stays.
void RestrictInliers(const KeptKeypoints& kept,
                     colmap::image_pair_t pair_id,
                     PairGeometry* geometry);

// The values, one a key point, of those that are kept.
template <typename T>
std::vector<T> RestrictToKept(const KeptKeypoints& kept,
                              colmap::image_t image_id,
                              std::vector<T> values) {
  const auto it = kept.find(image_id);
  if (it == kept.end()) return values;
  std::vector<T> restricted;
  restricted.reserve(it->second.size());
  for (const colmap::point2D_t i : it->second) {
    restricted.push_back(values.at(i));
  }
  return restricted;
}

}  // namespace dgsfm
