#include "colmap_ext/synthetic/synthetic_scene.h"

#include "colmap_ext/check.h"

#include <colmap/base/database.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <set>
#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

enum Purpose : uint32_t {
  POINTS,
  POSES,
  KEYPOINT_ORDER,
  IMAGE_NOISE,
  CLUTTER,
  CLUTTER_DEPTH,
  OUTLIER_MATCHES,
  NO_DEPTH,
  FALSE_PAIRS,
};

// Points are seen from at most this far [m] ...
constexpr double kMaxDepth = 40;
constexpr double kMinDepth = 0.5;
// ... and at most 60 degrees off their normal, as features are.
constexpr double kMinCosViewAngle = 0.5;
// Components are out of sight of each other [m].
constexpr double kComponentDistance = 1000;

struct Observation {
  colmap::image_t image_id;
  colmap::point2D_t point2D_idx;
};

class Synthesizer {
 public:
  explicit Synthesizer(const SyntheticSceneOptions& options) {
    scene_.options = options;
  }

  SyntheticScene Run() {
    DrawGeometry();
    Observe();
    if (Options().num_false_pairs > 0) {
      DuplicatePoints(DrawFalsePairs());
      Observe();
    }
    for (const SurfacePoint& point : points_) {
      scene_.points.push_back(point.xyz);
    }
    AddClutterAndNoise();
    AddDepth();
    MatchPairs();
    return std::move(scene_);
  }

 private:
  // Images a and b are matched as if b stood where c stands: the points seen
  // by a and c have doubles before b.
  struct FalsePair {
    colmap::image_t a, b, c;
    std::vector<std::pair<int, int>> doubles;  // original and double
  };

  const SyntheticSceneOptions& Options() const { return scene_.options; }
  RandomStream Random(Purpose purpose,
                      uint32_t index1 = 0,
                      uint32_t index2 = 0) const {
    return RandomStream(Options().random_seed, purpose, index1, index2);
  }

  void DrawGeometry();
  // Projects all points and tells which images observe each of them.
  void Observe();
  std::vector<FalsePair> DrawFalsePairs() const;
  void DuplicatePoints(std::vector<FalsePair> pairs);
  void AddClutterAndNoise();
  void AddDepth();
  void MatchPairs();
  // Common points of an image with all others, by image id.
  std::vector<int> CountCommonPoints(const SyntheticImage& image) const;
  std::set<std::pair<colmap::image_t, colmap::image_t>> SelectPairs() const;
  SyntheticPair MatchTrueKeypoints(colmap::image_t image_id1,
                                   colmap::image_t image_id2) const;
  SyntheticPair MatchDoubles(const FalsePair& pair) const;
  void AddOutliers(colmap::image_t image_id1,
                   colmap::image_t image_id2,
                   SyntheticPair* pair) const;
  colmap::point2D_t FindKeypoint(int point_idx, colmap::image_t image_id) const;

  SyntheticScene scene_;
  std::vector<SurfacePoint> points_;
  std::vector<std::vector<Observation>> tracks_;  // by point
  std::vector<FalsePair> false_pairs_;
};

void Synthesizer::DrawGeometry() {
  const SyntheticSceneOptions& options = Options();
  scene_.cameras = SynthesizeCameras(
      options.camera, options.num_images, options.random_seed);
  RandomStream point_random = Random(POINTS);
  int begin = 0;
  for (int component = 0; component < options.num_components; ++component) {
    const int end =
        (component + 1) * options.num_images / options.num_components;
    const TrajectoryLayout layout{options.trajectory,
                                  end - begin,
                                  {0, kComponentDistance * component, 0},
                                  kMaxDepth};
    const int num_points = options.num_points / options.num_components;
    for (int i = 0; i < num_points; ++i) {
      points_.push_back(layout.DrawPoint(&point_random));
    }
    for (int i = begin; i < end; ++i) {
      SyntheticImage image;
      image.image_id = i + 1;
      char name[32];
      std::snprintf(name, sizeof(name), "image%04d.jpg", i);
      image.name = name;
      image.camera_id = 1 + i % scene_.cameras.size();
      image.component = component;
      RandomStream random = Random(POSES, image.image_id);
      image.cam_from_world = layout.DrawPose(i - begin, &random);
      scene_.images.emplace(image.image_id, image);
    }
    begin = end;
  }
}

void Synthesizer::Observe() {
  tracks_.assign(points_.size(), {});
  for (auto& [image_id, image] : scene_.images) {
    const colmap::Camera& camera = scene_.cameras.at(image.camera_id);
    const Eigen::Vector3d center = image.cam_from_world.TargetOriginInSource();
    std::vector<std::pair<int, Eigen::Vector2d>> observations;
    for (size_t i = 0; i < points_.size(); ++i) {
      const Eigen::Vector3d to_camera = center - points_[i].xyz;
      const double cos_distance = to_camera.dot(points_[i].normal);
      if (cos_distance < kMinCosViewAngle * to_camera.norm()) continue;
      const Eigen::Vector3d in_cam = image.cam_from_world * points_[i].xyz;
      Eigen::Vector2d xy;
      if (in_cam.z() < kMaxDepth &&
          ProjectIntoImage(camera, in_cam, kMinDepth, &xy)) {
        observations.emplace_back(static_cast<int>(i), xy);
      }
    }
    // No stage may profit from equal order in all images.
    Random(KEYPOINT_ORDER, image_id).Shuffle(&observations);
    image.keypoints.clear();
    image.point_idxs.clear();
    for (const auto& [point_idx, xy] : observations) {
      tracks_[point_idx].push_back(
          {image_id, static_cast<colmap::point2D_t>(image.keypoints.size())});
      image.keypoints.push_back(xy);
      image.point_idxs.push_back(point_idx);
    }
  }
}

std::vector<int> Synthesizer::CountCommonPoints(
    const SyntheticImage& image) const {
  std::vector<int> counts(scene_.images.size() + 1, 0);
  for (const int point_idx : image.point_idxs) {
    if (point_idx < 0) continue;
    for (const Observation& observation : tracks_[point_idx]) {
      ++counts[observation.image_id];
    }
  }
  counts[image.image_id] = 0;
  return counts;
}

std::vector<Synthesizer::FalsePair> Synthesizer::DrawFalsePairs() const {
  std::vector<FalsePair> candidates;
  for (const auto& [image_id, image] : scene_.images) {
    const std::vector<int> counts = CountCommonPoints(image);
    const colmap::image_t best =
        std::max_element(counts.begin(), counts.end()) - counts.begin();
    if (counts[best] < Options().min_num_matches) continue;
    for (colmap::image_t other = 1; other < counts.size(); ++other) {
      if (other == image_id || counts[other] > 0) continue;
      candidates.push_back({image_id, other, best, {}});
    }
  }
  Random(FALSE_PAIRS).Shuffle(&candidates);
  std::vector<FalsePair> pairs;
  std::set<std::pair<colmap::image_t, colmap::image_t>> used;
  for (FalsePair& candidate : candidates) {
    if (pairs.size() == size_t(Options().num_false_pairs)) break;
    if (used.insert(std::minmax(candidate.a, candidate.b)).second) {
      pairs.push_back(std::move(candidate));
    }
  }
  DGSFM_CHECK(pairs.size() == size_t(Options().num_false_pairs))
      << "only " << pairs.size() << " image pairs have no common view";
  return pairs;
}

void Synthesizer::DuplicatePoints(std::vector<FalsePair> pairs) {
  for (FalsePair& pair : pairs) {
    const Rigid3d world_from_world =
        scene_.images.at(pair.b).cam_from_world.Inverse() *
        scene_.images.at(pair.c).cam_from_world;
    for (const int point_idx : scene_.images.at(pair.a).point_idxs) {
      if (FindKeypoint(point_idx, pair.c) == colmap::kInvalidPoint2DIdx) {
        continue;
      }
      pair.doubles.emplace_back(point_idx, static_cast<int>(points_.size()));
      const SurfacePoint original = points_[point_idx];
      points_.push_back({world_from_world * original.xyz,
                         world_from_world.rotation * original.normal});
    }
  }
  false_pairs_ = std::move(pairs);
}

void Synthesizer::AddClutterAndNoise() {
  const SyntheticSceneOptions& options = Options();
  // Enough for all outliers of a pair to be clutter.
  const double clutter_ratio =
      options.outlier_match_ratio / (1 - options.outlier_match_ratio);
  for (auto& [image_id, image] : scene_.images) {
    const Eigen::Vector2d size(options.camera.width_px,
                               options.camera.height_px);
    RandomStream noise_random = Random(IMAGE_NOISE, image_id);
    for (Eigen::Vector2d& xy : image.keypoints) {
      const Eigen::Vector2d noise{noise_random.Normal(), noise_random.Normal()};
      xy += options.image_noise_px * noise;
      xy = xy.cwiseMax(Eigen::Vector2d::Zero()).cwiseMin(size);
    }
    RandomStream random = Random(CLUTTER, image_id);
    const size_t num_clutter =
        std::ceil(clutter_ratio * image.keypoints.size());
    for (size_t i = 0; i < num_clutter; ++i) {
      const double x = random.Uniform(0, size.x());
      image.keypoints.emplace_back(x, random.Uniform(0, size.y()));
      image.point_idxs.push_back(-1);
    }
  }
}

void Synthesizer::AddDepth() {
  const SyntheticSceneOptions& options = Options();
  std::vector<colmap::image_t> ids(options.num_images);
  std::iota(ids.begin(), ids.end(), 1);
  Random(NO_DEPTH).Shuffle(&ids);
  ids.resize(std::lround((1 - options.no_depth_ratio) * ids.size()));
  std::sort(ids.begin(), ids.end());
  std::map<int, std::vector<colmap::image_t>> ids_of_component;
  for (const colmap::image_t image_id : ids) {
    ids_of_component[scene_.images.at(image_id).component].push_back(image_id);
  }
  for (const auto& [component, image_ids] : ids_of_component) {
    const std::vector<double> scales =
        SynthesizeDepthScales(options.depth_noise.log_scale_stddev,
                              image_ids.size(),
                              options.random_seed + component);
    for (size_t i = 0; i < image_ids.size(); ++i) {
      scene_.images.at(image_ids[i]).depth_scale = scales[i];
    }
  }
  for (const colmap::image_t image_id : ids) {
    SyntheticImage& image = scene_.images.at(image_id);
    RandomStream random = Random(CLUTTER_DEPTH, image_id);
    DepthNoise noise(
        options.depth_noise, image.depth_scale, options.random_seed, image_id);
    const size_t num_observed = std::count_if(
        image.point_idxs.begin(), image.point_idxs.end(), [](int point_idx) {
          return point_idx >= 0;
        });
    for (size_t i = 0; i < image.keypoints.size(); ++i) {
      // Clutter, which follows the points, has the depth of any of them.
      const int point_idx =
          image.point_idxs[i < num_observed ? i : random.Index(num_observed)];
      const double depth = (image.cam_from_world * points_[point_idx].xyz).z();
      const Eigen::Vector2d xy = image.keypoints[i].cwiseQuotient(
          Eigen::Vector2d(options.camera.width_px, options.camera.height_px));
      image.prior_depths.push_back(noise.PriorDepth(depth, xy));
    }
  }
}

colmap::point2D_t Synthesizer::FindKeypoint(int point_idx,
                                            colmap::image_t image_id) const {
  for (const Observation& observation : tracks_[point_idx]) {
    if (observation.image_id == image_id) return observation.point2D_idx;
  }
  return colmap::kInvalidPoint2DIdx;
}

std::set<std::pair<colmap::image_t, colmap::image_t>> Synthesizer::SelectPairs()
    const {
  std::set<std::pair<colmap::image_t, colmap::image_t>> selected;
  for (const auto& [image_id, image] : scene_.images) {
    const std::vector<int> counts = CountCommonPoints(image);
    std::vector<colmap::image_t> others(scene_.images.size());
    std::iota(others.begin(), others.end(), 1);
    std::stable_sort(others.begin(), others.end(), [&](auto a, auto b) {
      return counts[a] > counts[b];
    });
    others.resize(std::min(others.size(), size_t(Options().max_num_neighbors)));
    for (const colmap::image_t other : others) {
      if (counts[other] >= std::max(1, Options().min_num_matches)) {
        selected.insert(std::minmax(image_id, other));
      }
    }
  }
  for (const FalsePair& pair : false_pairs_) {
    selected.erase(std::minmax(pair.a, pair.b));
  }
  return selected;
}

SyntheticPair Synthesizer::MatchTrueKeypoints(colmap::image_t image_id1,
                                              colmap::image_t image_id2) const {
  const SyntheticImage& image1 = scene_.images.at(image_id1);
  SyntheticPair pair;
  pair.cam2_from_cam1 = scene_.images.at(image_id2).cam_from_world *
                        image1.cam_from_world.Inverse();
  for (colmap::point2D_t idx1 = 0; idx1 < image1.point_idxs.size(); ++idx1) {
    if (image1.point_idxs[idx1] < 0) continue;
    const auto idx2 = FindKeypoint(image1.point_idxs[idx1], image_id2);
    if (idx2 != colmap::kInvalidPoint2DIdx) {
      pair.matches.emplace_back(idx1, idx2);
    }
  }
  return pair;
}

SyntheticPair Synthesizer::MatchDoubles(const FalsePair& false_pair) const {
  SyntheticPair pair;
  pair.is_false = true;
  const Rigid3d b_from_a =
      scene_.images.at(false_pair.c).cam_from_world *
      scene_.images.at(false_pair.a).cam_from_world.Inverse();
  const bool swap = false_pair.b < false_pair.a;
  pair.cam2_from_cam1 = swap ? b_from_a.Inverse() : b_from_a;
  for (const auto& [original_idx, double_idx] : false_pair.doubles) {
    auto idx1 = FindKeypoint(original_idx, false_pair.a);
    auto idx2 = FindKeypoint(double_idx, false_pair.b);
    // The focal lengths of b and c may differ, and so their views.
    if (idx2 == colmap::kInvalidPoint2DIdx) continue;
    if (swap) std::swap(idx1, idx2);
    pair.matches.emplace_back(idx1, idx2);
  }
  return pair;
}

void Synthesizer::AddOutliers(colmap::image_t image_id1,
                              colmap::image_t image_id2,
                              SyntheticPair* pair) const {
  const double ratio = Options().outlier_match_ratio;
  const size_t num_outliers =
      std::lround(ratio / (1 - ratio) * pair->matches.size());
  const auto unmatched = [&](colmap::image_t image_id, bool second) {
    std::vector<bool> used(scene_.images.at(image_id).keypoints.size(), false);
    for (const colmap::FeatureMatch& match : pair->matches) {
      used[second ? match.point2D_idx2 : match.point2D_idx1] = true;
    }
    std::vector<colmap::point2D_t> idxs;
    for (colmap::point2D_t i = 0; i < used.size(); ++i) {
      if (!used[i]) idxs.push_back(i);
    }
    return idxs;
  };
  std::vector<colmap::point2D_t> idxs1 = unmatched(image_id1, false);
  std::vector<colmap::point2D_t> idxs2 = unmatched(image_id2, true);
  RandomStream random = Random(OUTLIER_MATCHES, image_id1, image_id2);
  random.Shuffle(&idxs1);
  random.Shuffle(&idxs2);
  pair->is_inlier.assign(pair->matches.size(), true);
  for (size_t i = 0; i < num_outliers; ++i) {
    pair->matches.emplace_back(idxs1[i], idxs2[i]);
    pair->is_inlier.push_back(false);
  }
}

void Synthesizer::MatchPairs() {
  const auto add = [this](colmap::image_t image_id1,
                          colmap::image_t image_id2,
                          SyntheticPair pair) {
    AddOutliers(image_id1, image_id2, &pair);
    scene_.pairs.emplace(
        colmap::Database::ImagePairToPairId(image_id1, image_id2),
        std::move(pair));
  };
  for (const auto& [image_id1, image_id2] : SelectPairs()) {
    add(image_id1, image_id2, MatchTrueKeypoints(image_id1, image_id2));
  }
  for (const FalsePair& pair : false_pairs_) {
    add(std::min(pair.a, pair.b), std::max(pair.a, pair.b), MatchDoubles(pair));
  }
}

}  // namespace

bool SyntheticSceneOptions::IsValid(std::string* error) const {
  const auto check = [error](const char* name, double value, double min) {
    if (value >= min) return true;
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be at least " + std::to_string(min);
    return false;
  };
  const auto check_ratio = [error](const char* name, double value) {
    if (value >= 0 && value < 1) return true;
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be in [0, 1)";
    return false;
  };
  return check("num_images", num_images, 1) &&
         check("num_points", num_points, 1) &&
         check("num_components", num_components, 1) &&
         check("num_images", num_images, num_components) &&
         check("image_noise_px", image_noise_px, 0) &&
         check("num_false_pairs", num_false_pairs, 0) &&
         check("max_num_neighbors", max_num_neighbors, 1) &&
         check("min_num_matches", min_num_matches, 1) &&
         check_ratio("outlier_match_ratio", outlier_match_ratio) &&
         check_ratio("no_depth_ratio", no_depth_ratio) &&
         camera.IsValid(error) && depth_noise.IsValid(error);
}

SyntheticScene SynthesizeScene(const SyntheticSceneOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  return Synthesizer(options).Run();
}

}  // namespace dgsfm
