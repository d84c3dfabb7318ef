#include "sfm/verification/relative_depth.h"

#include "estimators/median.h"
#include "estimators/solvers/epipolar.h"
#include "sfm/verification/centered_point.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace dgsfm {

namespace {

using Samples = std::vector<AffineDepthSample>;

// Places whose triangulated depth is less certain than this hardly determine
// the shift and bias it [1].
constexpr double kMaxDepthError = 0.05;
// Standard deviation of a key point [px].
constexpr double kKeypointStddevPx = 0.7;
// Further pairs of an image show the same, and take memory.
constexpr size_t kMaxNumPairsToJudge = 5;
// Values this many standard deviations of the shift from it have no depth.
constexpr double kMinShiftDeviations = 3;

struct TriangulatedMatch {
  colmap::FeatureMatch match;
  RayIntersection intersection;
};

// The inliers of a pair whose depth is certain.
std::vector<TriangulatedMatch> TriangulatePair(const Scene& scene,
                                               colmap::image_pair_t pair_id,
                                               const PairGeometry& pair) {
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  const colmap::Image& image1 = scene.images.at(image_id1);
  const colmap::Image& image2 = scene.images.at(image_id2);
  const colmap::Camera& camera1 = scene.cameras.at(image1.CameraId());
  const colmap::Camera& camera2 = scene.cameras.at(image2.CameraId());
  TwoViewModel model;
  model.rotation = pair.cam2_from_cam1.rotation.toRotationMatrix();
  model.translation = pair.cam2_from_cam1.translation;
  model.focal1 = camera1.MeanFocalLength();
  model.focal2 = camera2.MeanFocalLength();
  const double angle_stddev_rad =
      kKeypointStddevPx * std::hypot(1 / model.focal1, 1 / model.focal2);
  std::vector<TriangulatedMatch> triangulated;
  for (const colmap::FeatureMatch& match : pair.inlier_matches) {
    const auto point1 =
        UndistortPoint(camera1, image1.Point2D(match.point2D_idx1).XY());
    const auto point2 =
        UndistortPoint(camera2, image2.Point2D(match.point2D_idx2).XY());
    if (!point1 || !point2) continue;
    const auto intersection =
        IntersectRays(model, point1->point, point2->point);
    if (intersection &&
        std::sin(intersection->angle_rad) * kMaxDepthError > angle_stddev_rad) {
      triangulated.push_back({match, *intersection});
    }
  }
  return triangulated;
}

// Whether the pose of a pair, estimated without depth, determines depths.
bool Triangulates(const PairGeometry& pair) {
  return pair.status == PairStatus::VALID &&
         !pair.Has(PairDegeneracy::ROTATION_ONLY) &&
         !pair.Has(PairDegeneracy::PLANAR);
}

void AddSample(const KeypointDepths& depths,
               colmap::point2D_t point2D_idx,
               double depth,
               Samples* samples) {
  const double value = depths.depths.at(point2D_idx);
  if (value == 0) return;
  const double predictor =
      depths.unit == DepthUnit::AFFINE_DISPARITY ? 1 / depth : depth;
  if (std::isfinite(predictor) && predictor > 0) {
    samples->push_back({value, predictor});
  }
}

// The depths that a fit gives, with the median 1.
AffineDepth AffineOf(const KeypointDepths& depths, const AffineDepthFit& fit) {
  AffineDepth affine;
  affine.unit = depths.unit;
  affine.shift = fit.shift;
  affine.min_difference = kMinShiftDeviations * fit.shift_stddev;
  std::vector<double> differences;
  for (const float value : depths.depths) {
    const double difference = value - affine.shift;
    if (value != 0 && difference > affine.min_difference) {
      differences.push_back(difference);
    }
  }
  if (!differences.empty()) affine.scale = Median(std::move(differences));
  return affine;
}

// Samples of each image, by pairs.
using ImageSamples = std::map<colmap::image_t, std::vector<Samples>>;

bool HasPairs(const ImageSamples& samples,
              colmap::image_t image_id,
              size_t num_pairs) {
  const auto found = samples.find(image_id);
  return found != samples.end() && found->second.size() >= num_pairs;
}

template <typename IsWanted>
ImageSamples CollectSamples(const Scene& scene,
                            const PairGeometries& pairs,
                            const KeypointDepthMap& depths,
                            size_t max_num_pairs,
                            const IsWanted& is_wanted) {
  ImageSamples samples;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (!Triangulates(pair) || (HasPairs(samples, image_id1, max_num_pairs) &&
                                HasPairs(samples, image_id2, max_num_pairs))) {
      continue;
    }
    const auto triangulated = TriangulatePair(scene, pair_id, pair);
    for (const bool is_first : {true, false}) {
      const colmap::image_t image_id = is_first ? image_id1 : image_id2;
      const auto found = depths.find(image_id);
      if (found == depths.end() || !is_wanted(found->second) ||
          HasPairs(samples, image_id, max_num_pairs)) {
        continue;
      }
      Samples of_pair;
      for (const TriangulatedMatch& point : triangulated) {
        AddSample(
            found->second,
            is_first ? point.match.point2D_idx1 : point.match.point2D_idx2,
            is_first ? point.intersection.depth1 : point.intersection.depth2,
            &of_pair);
      }
      samples[image_id].push_back(std::move(of_pair));
    }
  }
  return samples;
}

}  // namespace

bool HasAffineDepths(const KeypointDepthMap& depths) {
  return std::any_of(depths.begin(), depths.end(), [](const auto& image) {
    return IsAffine(image.second.unit);
  });
}

RelativeDepthFits FitRelativeDepths(const Scene& scene,
                                    const PairGeometries& pairs,
                                    const KeypointDepthMap& depths,
                                    const AffineDepthFitOptions& options) {
  ImageSamples samples = CollectSamples(
      scene,
      pairs,
      depths,
      /*max_num_pairs=*/std::numeric_limits<size_t>::max(),
      [](const KeypointDepths& image) { return IsAffine(image.unit); });
  RelativeDepthFits fits;
  for (const auto& [image_id, image_depths] : depths) {
    if (!IsAffine(image_depths.unit)) continue;
    RelativeDepthFit& result = fits[image_id];
    result.fit = FitAffineDepth(samples[image_id], options);
    if (result.fit.success) {
      result.affine = AffineOf(image_depths, result.fit);
    }
  }
  return fits;
}

RelativeDepthFit FitRelativeDepth(const KeypointDepths& depths,
                                  const std::vector<MeasuredDepth>& measured) {
  Samples samples;
  for (const MeasuredDepth& point : measured) {
    AddSample(depths, point.point2D_idx, point.depth, &samples);
  }
  RelativeDepthFit result;
  result.fit = FitAffineDepth({samples}, AffineDepthFitOptions());
  if (result.fit.success) {
    result.affine = {depths.unit, result.fit.scales[0], result.fit.shift, 0};
  }
  return result;
}

bool DepthsFallWithDepth(const Scene& scene,
                         const PairGeometries& pairs,
                         const KeypointDepthMap& depths) {
  const ImageSamples samples = CollectSamples(
      scene,
      pairs,
      depths,
      kMaxNumPairsToJudge,
      [](const KeypointDepths& image) { return !IsAffine(image.unit); });
  double sum = 0;
  size_t num_images = 0;
  for (const auto& [image_id, of_pairs] : samples) {
    double sum_of_image = 0;
    size_t num_samples = 0;
    for (const Samples& of_pair : of_pairs) {
      sum_of_image += double(of_pair.size()) * Concordance(of_pair);
      num_samples += of_pair.size();
    }
    if (num_samples < kMinNumJudgedPlaces) continue;
    sum += sum_of_image / double(num_samples);
    ++num_images;
  }
  return num_images >= kMinNumJudgedImages &&
         sum < -kMinMeanConcordance * double(num_images);
}

AffineDepths ApplyRelativeDepthFits(const RelativeDepthFits& fits,
                                    KeypointDepthMap* depths) {
  AffineDepths applied;
  for (const auto& [image_id, fit] : fits) {
    const auto found = depths->find(image_id);
    if (found == depths->end()) continue;
    if (fit.fit.success) {
      ConvertAffine(fit.affine, &found->second);
      applied[image_id] = fit.affine;
    } else {
      depths->erase(found);
    }
  }
  return applied;
}

}  // namespace dgsfm
