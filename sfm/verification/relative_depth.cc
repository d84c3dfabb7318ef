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

Samples SamplesOf(const KeypointDepths& depths,
                  const MeasuredDepths& measured) {
  Samples samples;
  for (const MeasuredDepth& point : measured) {
    const double value = depths.depths.at(point.point2D_idx);
    if (value == 0) continue;
    const double predictor = depths.unit == DepthUnit::AFFINE_DISPARITY
                                 ? 1 / point.depth
                                 : point.depth;
    if (std::isfinite(predictor) && predictor > 0) {
      samples.push_back({value, predictor});
    }
  }
  return samples;
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

}  // namespace

bool HasAffineDepths(const KeypointDepthMap& depths) {
  return std::any_of(depths.begin(), depths.end(), [](const auto& image) {
    return IsAffine(image.second.unit);
  });
}

DepthsOfPairs MeasureDepthsByPairs(
    const Scene& scene,
    const PairGeometries& pairs,
    const std::vector<colmap::image_t>& image_ids,
    size_t max_num_pairs) {
  DepthsOfPairs measured;
  for (const colmap::image_t image_id : image_ids) measured[image_id];
  for (const auto& [pair_id, pair] : pairs) {
    if (!Triangulates(pair)) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto is_wanted = [&](colmap::image_t image_id) {
      const auto found = measured.find(image_id);
      return found != measured.end() && found->second.size() < max_num_pairs;
    };
    const bool wants1 = is_wanted(image_id1), wants2 = is_wanted(image_id2);
    if (!wants1 && !wants2) continue;
    MeasuredDepths depths1, depths2;
    for (const TriangulatedMatch& point :
         TriangulatePair(scene, pair_id, pair)) {
      depths1.push_back({point.match.point2D_idx1, point.intersection.depth1});
      depths2.push_back({point.match.point2D_idx2, point.intersection.depth2});
    }
    if (wants1) measured[image_id1].push_back(std::move(depths1));
    if (wants2) measured[image_id2].push_back(std::move(depths2));
  }
  return measured;
}

RelativeDepthFits FitRelativeDepths(const Scene& scene,
                                    const PairGeometries& pairs,
                                    const KeypointDepthMap& depths,
                                    const AffineDepthFitOptions& options) {
  std::vector<colmap::image_t> image_ids;
  for (const auto& [image_id, image_depths] : depths) {
    if (IsAffine(image_depths.unit)) image_ids.push_back(image_id);
  }
  RelativeDepthFits fits;
  for (const auto& [image_id, of_pairs] : MeasureDepthsByPairs(
           scene, pairs, image_ids, std::numeric_limits<size_t>::max())) {
    const KeypointDepths& image_depths = depths.at(image_id);
    std::vector<Samples> samples;
    for (const MeasuredDepths& measured : of_pairs) {
      samples.push_back(SamplesOf(image_depths, measured));
    }
    RelativeDepthFit& result = fits[image_id];
    result.fit = FitAffineDepth(samples, options);
    if (result.fit.success) {
      result.affine = AffineOf(image_depths, result.fit);
    }
  }
  return fits;
}

RelativeDepthFit FitRelativeDepth(const KeypointDepths& depths,
                                  const MeasuredDepths& measured) {
  RelativeDepthFit result;
  result.fit =
      FitAffineDepth({SamplesOf(depths, measured)}, AffineDepthFitOptions());
  if (result.fit.success) {
    result.affine = {depths.unit, result.fit.scales[0], result.fit.shift, 0};
  }
  return result;
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
