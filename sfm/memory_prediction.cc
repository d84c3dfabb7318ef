#include "sfm/memory_prediction.h"

#include "estimators/optimization/point_minimizer.h"
#include "estimators/optimization/reduced_system.h"
#include "sfm/intrinsics/intrinsics_posterior.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

namespace dgsfm {

namespace {

// A model of the two largest moments: when tracks are joined, the inlier
// matches are in memory, and when the model is adjusted and completed, its
// observations. By the sizes of what is held then, and for observations by
// peaks of synthetic scenes of 60 to 3,000 images [byte].
constexpr double kProcessBytes = 25e6;
constexpr double kBytesPerImage = 36e3;
constexpr double kBytesPerKeypoint = 52;
constexpr double kBytesPerPair = 400;
// While tracks are joined.
constexpr double kBytesPerMatch = 10;
constexpr double kBytesPerTrackedKeypoint = 80;
// While the model is adjusted and completed.
constexpr double kBytesPerKeypointOfModel = 28;
// Bytes of a matched key point, whether or not it becomes an observation.
constexpr double kBytesPerMatchedKeypoint = 75;
constexpr double kBytesPerObservation = 130;
// Columns of a pose, and of the intrinsics of a camera: its focal length,
// distortion, and principal point.
constexpr double kNumColumnsPerPose = 6;
constexpr double kNumColumnsPerCamera = 4;
// Derivatives of an observation, where the factor would be too large.
constexpr double kBytesPerRow = 88;
constexpr double kBytesPerCalibrationImage = 0.45e6;

// Observations of an image below which its pose suffers.
constexpr int kMinNumObservations = 200;
// Observations of a long track.
constexpr double kNumObservationsOfLongTrack = 20;

constexpr double kBytesPerGb = 1e9;

// Counts matches and the key points that they match.
class MatchCounter {
 public:
  explicit MatchCounter(const Scene& scene) : scene_(scene) {
    size_.num_images = scene.images.size();
    std::set<colmap::camera_t> camera_ids;
    for (const auto& [image_id, image] : scene.images) {
      size_.num_keypoints += image.NumPoints2D();
      camera_ids.insert(image.CameraId());
    }
    size_.num_cameras = camera_ids.size();
  }

  void Add(colmap::image_pair_t pair_id,
           const colmap::FeatureMatches& matches) {
    size_.num_matches += matches.size();
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    links_.emplace_back(IndexOf(image_id1), IndexOf(image_id2));
    std::vector<bool>& is_matched1 = MatchedOf(image_id1);
    std::vector<bool>& is_matched2 = MatchedOf(image_id2);
    for (const colmap::FeatureMatch& match : matches) {
      is_matched1[match.point2D_idx1] = true;
      is_matched2[match.point2D_idx2] = true;
    }
  }

  MappingSize Finish(size_t num_pairs) {
    size_.num_pairs = num_pairs;
    for (const auto& [image_id, is_matched] : is_matched_) {
      size_.num_matched_keypoints.push_back(
          size_t(std::count(is_matched.begin(), is_matched.end(), true)));
    }
    size_.num_factor_blocks = ReducedSystem::AnalyzeFactor(
                                  int(size_.num_images),
                                  [this](const auto& couple) {
                                    for (const auto& [image1, image2] : links_)
                                      couple(image1, image2);
                                  })
                                  .num_entries;
    return std::move(size_);
  }

 private:
  std::vector<bool>& MatchedOf(colmap::image_t image_id) {
    std::vector<bool>& is_matched = is_matched_[image_id];
    if (is_matched.empty()) {
      is_matched.resize(scene_.images.at(image_id).NumPoints2D());
    }
    return is_matched;
  }

  int IndexOf(colmap::image_t image_id) {
    return indices_.emplace(image_id, int(indices_.size())).first->second;
  }

  const Scene& scene_;
  MappingSize size_;
  // Images in the order in which pairs name them, and the pairs.
  std::map<colmap::image_t, int> indices_;
  std::vector<std::pair<int, int>> links_;
  std::map<colmap::image_t, std::vector<bool>> is_matched_;
};

double NumObservations(const TrackOptions& options, const MappingSize& size) {
  double count = 0;
  for (const size_t num_matched : size.num_matched_keypoints) {
    count += options.max_num_observations_per_image > 0
                 ? std::min<double>(double(num_matched),
                                    options.max_num_observations_per_image)
                 : double(num_matched);
  }
  if (options.max_num_tracks > 0) {
    count =
        std::min(count, kNumObservationsOfLongTrack * options.max_num_tracks);
  }
  return count;
}

// The factor and the matrix, or what conjugate gradients need instead.
double SolverBytes(const TrackOptions& options, const MappingSize& size) {
  const double num_columns = kNumColumnsPerPose + kNumColumnsPerCamera *
                                                      double(size.num_cameras) /
                                                      double(size.num_images);
  const double num_entries = num_columns * num_columns * size.num_factor_blocks;
  return num_entries <= PointMinimizerOptions().max_num_factor_entries
             ? 2 * sizeof(double) * num_entries
             : kBytesPerRow * NumObservations(options, size);
}

std::string Text(double gb) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.3g", gb);
  return text;
}

// The largest bound of observations with which the mapping fits, in round
// numbers; 0 if there is none.
int FittingBound(double limit_gb,
                 TrackOptions options,
                 const MappingSize& size) {
  int fitting = 0;
  for (int bound = kMinNumObservations;; bound += bound / 10) {
    bound -= bound % 10;
    options.max_num_observations_per_image = bound;
    if (PredictMemoryGb(options, size) > limit_gb) return fitting;
    fitting = bound;
  }
}

}  // namespace

MappingSize SizeByMatches(const Scene& scene) {
  MatchCounter counter(scene);
  for (const auto& [pair_id, matches] : scene.matches) {
    counter.Add(pair_id, MatchesOf(scene, pair_id));
  }
  return counter.Finish(scene.matches.size());
}

MappingSize SizeByInliers(const Scene& scene, const PairGeometries& pairs) {
  MatchCounter counter(scene);
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status == PairStatus::VALID) {
      counter.Add(pair_id, pair.inlier_matches);
    }
  }
  return counter.Finish(pairs.size());
}

double PredictMemoryGb(const TrackOptions& options, const MappingSize& size) {
  const double num_matched = std::accumulate(size.num_matched_keypoints.begin(),
                                             size.num_matched_keypoints.end(),
                                             0.0);
  const double num_images = double(size.num_images);
  const double num_keypoints = double(size.num_keypoints);
  const double scene = kProcessBytes + kBytesPerImage * num_images +
                       kBytesPerKeypoint * num_keypoints +
                       kBytesPerPair * double(size.num_pairs);
  const double joining = kBytesPerMatch * double(size.num_matches) +
                         kBytesPerTrackedKeypoint * num_matched;
  const double adjusting =
      kBytesPerKeypointOfModel * num_keypoints +
      kBytesPerMatchedKeypoint * num_matched +
      kBytesPerObservation * NumObservations(options, size) +
      kBytesPerCalibrationImage *
          std::min<double>(num_images, kMaxNumPosteriorImages) +
      SolverBytes(options, size);
  return (scene + std::max(joining, adjusting)) / kBytesPerGb;
}

void CheckMemory(double limit_gb,
                 const TrackOptions& options,
                 const MappingSize& size) {
  const double needed_gb = PredictMemoryGb(options, size);
  if (needed_gb <= limit_gb) return;
  const std::string problem = "the mapping needs about " + Text(needed_gb) +
                              " GB of memory, more than --memory_limit_gb " +
                              Text(limit_gb) + ": ";
  const int bound = FittingBound(limit_gb, options, size);
  if (bound == 0) {
    throw std::runtime_error(
        problem +
        "use fewer key points of each image "
        "(--max_num_keypoints_per_image), or map fewer images at a "
        "time");
  }
  throw std::runtime_error(problem +
                           "it fits with --max_num_observations_per_image " +
                           std::to_string(bound));
}

}  // namespace dgsfm
