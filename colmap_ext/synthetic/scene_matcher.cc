#include "colmap_ext/synthetic/scene_matcher.h"

#include "colmap_ext/scene.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Geometry>

namespace dgsfm {

namespace {

enum Purpose : uint32_t { OUTLIER_MATCHES = 6, LOOK_ALIKES = 9 };

// Key points of an image that no match of a pair uses.
std::vector<colmap::point2D_t> UnmatchedKeypoints(
    const SyntheticImage& image,
    const colmap::FeatureMatches& matches,
    colmap::point2D_t colmap::FeatureMatch::*point2D_idx) {
  std::vector<bool> used(image.keypoints.size(), false);
  for (const colmap::FeatureMatch& match : matches) {
    used[match.*point2D_idx] = true;
  }
  std::vector<colmap::point2D_t> idxs;
  for (colmap::point2D_t i = 0; i < used.size(); ++i) {
    if (!used[i]) idxs.push_back(i);
  }
  return idxs;
}

}  // namespace

SceneMatcher::SceneMatcher(const ScenePoints& points, SyntheticScene* scene)
    : points_(points),
      scene_(scene),
      covisibility_(scene->images, scene->points.size()) {}

void SceneMatcher::Match(const std::vector<FalsePair>& false_pairs) {
  ImagePairs image_pairs = SelectPairs();
  // A copied point may be common to two images by chance.
  for (const FalsePair& pair : false_pairs) {
    image_pairs.erase(std::minmax(pair.a, pair.b));
  }
  MatchCommonPoints(image_pairs);
  for (const FalsePair& pair : false_pairs) MatchLookAlikes(pair);
  MatchRepeats();
}

SceneMatcher::ImagePairs SceneMatcher::SelectPairs() const {
  const size_t max_num_neighbors = scene_->options.max_num_neighbors;
  const size_t num_best = (max_num_neighbors + 1) / 2;
  const size_t num_spread = max_num_neighbors - num_best;
  ImagePairs selected;
  for (const auto& [image_id, image] : scene_->images) {
    auto neighbors = covisibility_.CountObservers(image.point_idxs, image_id);
    neighbors.erase(std::remove_if(neighbors.begin(),
                                   neighbors.end(),
                                   [this](const auto& neighbor) {
                                     return neighbor.second <
                                            scene_->options.min_num_matches;
                                   }),
                    neighbors.end());
    std::stable_sort(
        neighbors.begin(), neighbors.end(), [](const auto& a, const auto& b) {
          return a.second > b.second;
        });
    if (neighbors.size() > max_num_neighbors) {
      const size_t num_rest = neighbors.size() - num_best;
      for (size_t i = 0; i < num_spread; ++i) {
        neighbors[num_best + i] =
            neighbors[num_best + (i + 1) * num_rest / num_spread - 1];
      }
      neighbors.resize(max_num_neighbors);
    }
    for (const auto& [other_id, count] : neighbors) {
      selected.insert(std::minmax(image_id, other_id));
    }
  }
  return selected;
}

Rigid3d SceneMatcher::MotionOf(
    const std::vector<std::pair<int, int>>& point_idxs) const {
  Eigen::Matrix3Xd first(3, point_idxs.size());
  Eigen::Matrix3Xd second(3, point_idxs.size());
  for (size_t i = 0; i < point_idxs.size(); ++i) {
    first.col(i) = scene_->points[point_idxs[i].first];
    second.col(i) = scene_->points[point_idxs[i].second];
  }
  const Eigen::Matrix4d motion =
      Eigen::umeyama(first, second, /*with_scaling=*/false);
  return Rigid3d(Eigen::Quaterniond(motion.topLeftCorner<3, 3>()).normalized(),
                 motion.topRightCorner<3, 1>());
}

FalsePair SceneMatcher::FindLookAlike(const SyntheticImage& image,
                                      int step) const {
  FalsePair pair;
  pair.a = image.image_id;
  std::vector<int> look_alike_idxs;
  for (const int point_idx : image.point_idxs) {
    look_alike_idxs.push_back(
        point_idx < 0 ? -1 : points_.LookAlike(point_idx, step));
    if (look_alike_idxs.back() >= 0) {
      pair.look_alikes.emplace_back(point_idx, look_alike_idxs.back());
    }
  }
  const auto common = covisibility_.CountObservers(image.point_idxs, pair.a);
  const std::map<colmap::image_t, int> related(common.begin(), common.end());
  int max_count = scene_->options.min_num_matches - 1;
  for (const auto& [image_id, count] :
       covisibility_.CountObservers(look_alike_idxs, pair.a)) {
    if (count > max_count && related.count(image_id) == 0 &&
        scene_->pairs.count(PairIdOfImages(pair.a, image_id)) == 0) {
      max_count = count;
      pair.b = image_id;
    }
  }
  if (pair.b == colmap::kInvalidImageId) return pair;
  const Rigid3d world_from_world = MotionOf(pair.look_alikes);
  pair.b_from_a = scene_->images.at(pair.b).cam_from_world * world_from_world *
                  image.cam_from_world.Inverse();
  return pair;
}

void SceneMatcher::MatchRepeats() {
  const SyntheticSceneOptions& options = scene_->options;
  const int max_step = points_.MaxStep();
  if (max_step == 0) return;
  for (const auto& [image_id, image] : scene_->images) {
    RandomStream random(options.random_seed, LOOK_ALIKES, image_id);
    for (int i = 0; i < options.max_num_look_alikes; ++i) {
      const int step = 1 + static_cast<int>(random.Index(max_step));
      FalsePair pair = FindLookAlike(image, step);
      if (pair.b == colmap::kInvalidImageId) {
        pair = FindLookAlike(image, -step);
      }
      if (pair.b != colmap::kInvalidImageId) MatchLookAlikes(pair);
    }
  }
}

void SceneMatcher::MatchCommonPoints(const ImagePairs& image_pairs) {
  std::vector<colmap::FeatureMatches*> matches_with(scene_->images.size() + 1);
  for (auto first = image_pairs.begin(); first != image_pairs.end();) {
    const SyntheticImage& image1 = scene_->images.at(first->first);
    std::map<colmap::image_t, SyntheticPair> pairs;
    auto last = first;
    for (; last != image_pairs.end() && last->first == first->first; ++last) {
      SyntheticPair& pair = pairs[last->second];
      pair.cam2_from_cam1 = scene_->images.at(last->second).cam_from_world *
                            image1.cam_from_world.Inverse();
      matches_with[last->second] = &pair.matches;
    }
    for (colmap::point2D_t i = 0; i < image1.point_idxs.size(); ++i) {
      if (image1.point_idxs[i] < 0) continue;
      for (const auto& [image_id, point2D_idx] :
           covisibility_.Track(image1.point_idxs[i])) {
        if (matches_with[image_id] != nullptr) {
          matches_with[image_id]->emplace_back(i, point2D_idx);
        }
      }
    }
    for (auto& [image_id2, pair] : pairs) {
      matches_with[image_id2] = nullptr;
      Add(image1.image_id, image_id2, std::move(pair));
    }
    first = last;
  }
}

void SceneMatcher::MatchLookAlikes(const FalsePair& false_pair) {
  SyntheticPair pair;
  pair.is_false = true;
  const bool swap = false_pair.b < false_pair.a;
  pair.cam2_from_cam1 =
      swap ? false_pair.b_from_a.Inverse() : false_pair.b_from_a;
  for (const auto& [point_idx_a, point_idx_b] : false_pair.look_alikes) {
    auto idx1 = covisibility_.FindKeypoint(point_idx_a, false_pair.a);
    auto idx2 = covisibility_.FindKeypoint(point_idx_b, false_pair.b);
    // The fields of view may differ.
    if (idx2 == colmap::kInvalidPoint2DIdx) continue;
    if (swap) std::swap(idx1, idx2);
    pair.matches.emplace_back(idx1, idx2);
  }
  const auto [image_id1, image_id2] = std::minmax(false_pair.a, false_pair.b);
  Add(image_id1, image_id2, std::move(pair));
}

void SceneMatcher::AddOutliers(colmap::image_t image_id1,
                               colmap::image_t image_id2,
                               SyntheticPair* pair) const {
  pair->is_inlier.assign(pair->matches.size(), true);
  const double ratio = scene_->options.outlier_match_ratio;
  if (ratio == 0) return;
  std::vector<colmap::point2D_t> idxs1 =
      UnmatchedKeypoints(scene_->images.at(image_id1),
                         pair->matches,
                         &colmap::FeatureMatch::point2D_idx1);
  std::vector<colmap::point2D_t> idxs2 =
      UnmatchedKeypoints(scene_->images.at(image_id2),
                         pair->matches,
                         &colmap::FeatureMatch::point2D_idx2);
  RandomStream random(
      scene_->options.random_seed, OUTLIER_MATCHES, image_id1, image_id2);
  random.Shuffle(&idxs1);
  random.Shuffle(&idxs2);
  const size_t num_outliers =
      std::lround(ratio / (1 - ratio) * pair->matches.size());
  for (size_t i = 0; i < num_outliers; ++i) {
    pair->matches.emplace_back(idxs1[i], idxs2[i]);
    pair->is_inlier.push_back(false);
  }
}

void SceneMatcher::Add(colmap::image_t image_id1,
                       colmap::image_t image_id2,
                       SyntheticPair pair) {
  AddOutliers(image_id1, image_id2, &pair);
  scene_->pairs.emplace(PairIdOfImages(image_id1, image_id2), std::move(pair));
}

}  // namespace dgsfm
