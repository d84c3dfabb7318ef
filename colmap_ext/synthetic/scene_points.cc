#include "colmap_ext/synthetic/scene_points.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/covisibility.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

namespace dgsfm {

namespace {

// Points nearer to the camera are not in focus [m].
constexpr double kMinDepth = 0.5;
// Features are found up to 60 degrees off their normal.
constexpr double kMinCosViewAngle = 0.5;
// A compromise of cells to look into and images to project into [m].
constexpr double kCellSize = 10;
// Where hardly a point is seen (e.g. by a long lens), images have fewer than
// wanted.
constexpr size_t kMaxNumDrawsPerKeypoint = 100;

bool SeesPoint(const SurfacePoint& point,
               const colmap::Camera& camera,
               const Rigid3d& cam_from_world,
               const Eigen::Vector3d& center,
               Eigen::Vector2d* xy) {
  const Eigen::Vector3d to_camera = center - point.xyz;
  const double distance = to_camera.norm();
  return distance >= point.min_distance && distance <= point.max_distance &&
         to_camera.dot(point.normal) >= kMinCosViewAngle * distance &&
         ProjectIntoImage(camera, cam_from_world * point.xyz, kMinDepth, xy);
}

}  // namespace

ScenePoints::ScenePoints(SyntheticScene* scene) : scene_(scene) {
  for (auto& [image_id, image] : scene->images) {
    const Eigen::Vector3d center = image.cam_from_world.TargetOriginInSource();
    views_[CellOf(center)].push_back(
        {&image, &scene->cameras.at(image.camera_id), center});
  }
}

ScenePoints::Cell ScenePoints::CellOf(const Eigen::Vector3d& xyz) {
  return {static_cast<int>(std::floor(xyz.x() / kCellSize)),
          static_cast<int>(std::floor(xyz.y() / kCellSize))};
}

void ScenePoints::Draw(const SceneLayout& layout,
                       const Eigen::Vector3d& origin,
                       size_t num_images,
                       int num_keypoints,
                       RandomStream* random) {
  const size_t num_wanted = num_images * num_keypoints;
  const size_t max_num_draws = kMaxNumDrawsPerKeypoint * num_wanted;
  size_t num_observed = 0, num_draws = 0;
  while (num_observed < num_wanted && num_draws < max_num_draws) {
    const int begin = static_cast<int>(points_.size());
    size_t num_observed_now = 0;
    for (SurfacePoint& point : layout.DrawPoints(random)) {
      ++num_draws;
      point.xyz += origin;
      num_observed_now += Observe(point, static_cast<int>(points_.size()));
      Add(point, begin);
    }
    if (num_observed_now == 0) {
      points_.resize(begin);
      looks_.resize(begin);
      scene_->points.resize(begin);
    }
    num_observed += num_observed_now;
  }
}

void ScenePoints::Add(const SurfacePoint& point, int look) {
  points_.push_back(point);
  max_step_ = std::max(max_step_, static_cast<int>(looks_.size()) - look);
  looks_.push_back(look);
  scene_->points.push_back(point.xyz);
}

size_t ScenePoints::Observe(const SurfacePoint& point, int point_idx) {
  const Eigen::Vector3d reach(point.max_distance, point.max_distance, 0);
  const Cell min = CellOf(point.xyz - reach);
  const Cell max = CellOf(point.xyz + reach);
  size_t num_observed = 0;
  for (int x = min.first; x <= max.first; ++x) {
    for (auto cell = views_.lower_bound({x, min.second});
         cell != views_.end() && cell->first <= Cell(x, max.second);
         ++cell) {
      for (const View& view : cell->second) {
        Eigen::Vector2d xy;
        if (SeesPoint(point,
                      *view.camera,
                      view.image->cam_from_world,
                      view.center,
                      &xy)) {
          view.image->keypoints.push_back(xy);
          view.image->point_idxs.push_back(point_idx);
          ++num_observed;
        }
      }
    }
  }
  return num_observed;
}

std::vector<FalsePair> ScenePoints::SelectFalsePairs(
    int num_pairs, int min_num_matches, RandomStream* random) const {
  const Covisibility covisibility(scene_->images, points_.size());
  std::vector<colmap::image_t> image_ids(scene_->images.size());
  std::iota(image_ids.begin(), image_ids.end(), 1);
  random->Shuffle(&image_ids);
  std::vector<FalsePair> pairs;
  std::set<std::pair<colmap::image_t, colmap::image_t>> used;
  const auto add_pair_of = [&](colmap::image_t a) {
    const SyntheticImage& image = scene_->images.at(a);
    const auto counts =
        covisibility.CountObservers(image.point_idxs, /*except=*/a);
    const auto best = std::max_element(
        counts.begin(), counts.end(), [](const auto& x, const auto& y) {
          return x.second < y.second;
        });
    if (best == counts.end() || best->second < min_num_matches) return;
    const std::map<colmap::image_t, int> related(counts.begin(), counts.end());
    std::vector<colmap::image_t> unrelated;
    for (const colmap::image_t b : image_ids) {
      if (b != a && related.count(b) == 0 &&
          used.count(std::minmax(a, b)) == 0) {
        unrelated.push_back(b);
      }
    }
    if (unrelated.empty()) return;
    const colmap::image_t b = unrelated[random->Index(unrelated.size())];
    used.insert(std::minmax(a, b));
    const colmap::image_t c = best->first;
    FalsePair& pair = pairs.emplace_back();
    pair.a = a;
    pair.b = b;
    pair.b_from_a =
        scene_->images.at(c).cam_from_world * image.cam_from_world.Inverse();
    for (const int point_idx : image.point_idxs) {
      if (covisibility.FindKeypoint(point_idx, c) !=
          colmap::kInvalidPoint2DIdx) {
        pair.look_alikes.emplace_back(point_idx, -1);
      }
    }
  };
  // One partner for each image in turn, until all are found or none is left.
  size_t num_before;
  do {
    num_before = pairs.size();
    for (const colmap::image_t a : image_ids) {
      if (pairs.size() < size_t(num_pairs)) add_pair_of(a);
    }
  } while (pairs.size() > num_before);
  DGSFM_CHECK(pairs.size() == size_t(num_pairs))
      << "only " << pairs.size() << " image pairs have no common view";
  return pairs;
}

std::vector<FalsePair> ScenePoints::AddFalsePairs(int num_pairs,
                                                  int min_num_matches,
                                                  RandomStream* random) {
  std::vector<FalsePair> pairs =
      SelectFalsePairs(num_pairs, min_num_matches, random);
  for (FalsePair& pair : pairs) {
    const Rigid3d world_from_world =
        scene_->images.at(pair.b).cam_from_world.Inverse() * pair.b_from_a *
        scene_->images.at(pair.a).cam_from_world;
    for (auto& [original_idx, copy_idx] : pair.look_alikes) {
      copy_idx = static_cast<int>(points_.size());
      SurfacePoint copy = points_[original_idx];
      copy.xyz = world_from_world * copy.xyz;
      copy.normal = world_from_world.rotation * copy.normal;
      Observe(copy, copy_idx);
      Add(copy, copy_idx);
    }
  }
  return pairs;
}

int ScenePoints::LookAlike(int point_idx, int step) const {
  const int other_idx = point_idx + step;
  if (other_idx < 0 || other_idx >= static_cast<int>(looks_.size()) ||
      looks_[other_idx] != looks_[point_idx]) {
    return -1;
  }
  return other_idx;
}

}  // namespace dgsfm
