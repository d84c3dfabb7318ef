#include "sfm/verification/pair_verification.h"

#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"
#include "estimators/option_check.h"
#include "estimators/random.h"
#include "estimators/two_view/two_view_residuals.h"
#include "sfm/verification/centered_point.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace dgsfm {

namespace {

// Undistorted if the camera is known, otherwise relative to the principal
// point. Nothing where the camera has no ray.
std::optional<CenteredPoint> CenterPoint(const colmap::Camera& camera,
                                         const Eigen::Vector2d& xy_px) {
  if (camera.HasPriorFocalLength()) return UndistortPoint(camera, xy_px);
  return CenteredPoint{xy_px - Eigen::Vector2d(camera.PrincipalPointX(),
                                               camera.PrincipalPointY())};
}

bool IsIdentity(const std::vector<Eigen::Matrix2d>& matrices) {
  // Beyond the rounding of numeric derivatives.
  constexpr double kTolerance = 1e-6;
  return std::all_of(
      matrices.begin(), matrices.end(), [&](const Eigen::Matrix2d& matrix) {
        return matrix.isIdentity(kTolerance);
      });
}

double KeypointDepth(const PairImage& image, colmap::point2D_t point2D_idx) {
  return image.depths ? image.depths->depths.at(point2D_idx) : 0;
}

// Those of the matches that have rays in both images, and these for the
// estimator.
struct UsableMatches {
  colmap::FeatureMatches matches;
  DepthMatches depth_matches;
};

UsableMatches CollectMatches(const PairImage& image1,
                             const PairImage& image2,
                             const colmap::FeatureMatches& matches) {
  UsableMatches usable;
  DepthMatches& data = usable.depth_matches;
  for (const colmap::FeatureMatch& match : matches) {
    const auto point1 = CenterPoint(
        image1.camera, image1.image.Point2D(match.point2D_idx1).XY());
    const auto point2 = CenterPoint(
        image2.camera, image2.image.Point2D(match.point2D_idx2).XY());
    if (!point1 || !point2) continue;
    usable.matches.push_back(match);
    data.points1.push_back(point1->point);
    data.points2.push_back(point2->point);
    data.pixel_jacobians1.push_back(point1->pixel_jacobian);
    data.pixel_jacobians2.push_back(point2->pixel_jacobian);
    data.depths1.push_back(KeypointDepth(image1, match.point2D_idx1));
    data.depths2.push_back(KeypointDepth(image2, match.point2D_idx2));
  }
  // The estimator is faster without.
  if (IsIdentity(data.pixel_jacobians1) && IsIdentity(data.pixel_jacobians2)) {
    data.pixel_jacobians1.clear();
    data.pixel_jacobians2.clear();
  }
  return usable;
}

// Standard deviation of the logarithm of the focal lengths that depth models
// see in single images [1].
constexpr double kDepthModelLogStddev = 0.25;

FocalPrior PriorOf(const PairImage& image) {
  if (image.focal_prior.Exists()) return image.focal_prior;
  if (!image.depths || image.depths->focal_length_px == 0) return {};
  return {image.depths->focal_length_px, kDepthModelLogStddev};
}

// Two images of one uncalibrated camera share their unknown focal length.
FocalCase FocalCaseOfPair(const colmap::Camera& camera1,
                          const colmap::Camera& camera2) {
  const bool known1 = camera1.HasPriorFocalLength();
  const bool known2 = camera2.HasPriorFocalLength();
  if (known1 && known2) return FocalCase::KNOWN;
  if (camera1.CameraId() == camera2.CameraId()) return FocalCase::SHARED;
  if (known1) return FocalCase::ONE_SIDED1;
  if (known2) return FocalCase::ONE_SIDED2;
  return FocalCase::TWO;
}

// Keeps the inliers that no depth map contradicts.
void SelectMatches(const TwoViewDepthResult& result,
                   const DepthMatches& depth_matches,
                   const colmap::FeatureMatches& matches,
                   const PairVerificationOptions& options,
                   PairGeometry* pair) {
  std::vector<DepthVerdict> verdicts(matches.size(), DepthVerdict::UNTESTED);
  if (result.has_scale) {
    DepthConsistencyOptions depth_consistency = options.depth_consistency;
    depth_consistency.max_depth_error_ratio =
        std::max(depth_consistency.max_depth_error_ratio,
                 options.depth_noise_factor * result.depth_noise);
    verdicts = CheckDepthConsistency(depth_matches,
                                     result.cam2_from_cam1,
                                     result.scale_1_from_2,
                                     result.focal_length1_px,
                                     result.focal_length2_px,
                                     depth_consistency);
  }
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!result.inlier_mask[i]) continue;
    if (options.filter_depth && verdicts[i] == DepthVerdict::INCONSISTENT) {
      continue;
    }
    pair->inlier_matches.push_back(matches[i]);
    pair->depth_verified.push_back(verdicts[i] == DepthVerdict::CONSISTENT);
  }
}

void CopyGeometry(const TwoViewDepthResult& result, PairGeometry* pair) {
  pair->cam2_from_cam1 = result.cam2_from_cam1;
  pair->has_scale = result.has_scale;
  pair->scale_1_from_2 = result.scale_1_from_2;
  pair->focal_length1_px = result.focal_length1_px;
  pair->focal_length2_px = result.focal_length2_px;
  pair->estimated_focal1 = result.estimated_focal1;
  pair->estimated_focal2 = result.estimated_focal2;
  if (result.has_covariance) {
    pair->log_scale_stddev =
        std::sqrt(result.covariance(kLogScaleParam, kLogScaleParam));
  }
  const TwoViewDegeneracy& degeneracy = result.degeneracy;
  if (degeneracy.planar) pair->Set(PairDegeneracy::PLANAR);
  if (degeneracy.rotation_only) pair->Set(PairDegeneracy::ROTATION_ONLY);
  if (degeneracy.stationary) pair->Set(PairDegeneracy::STATIONARY);
  if (!degeneracy.focal_identifiable1) pair->Set(PairDegeneracy::WEAK_FOCAL1);
  if (!degeneracy.focal_identifiable2) pair->Set(PairDegeneracy::WEAK_FOCAL2);
}

double MinNumInliers(const PairVerificationOptions& options,
                     size_t num_matches) {
  return std::max<double>(options.min_num_inliers,
                          options.min_inlier_ratio * double(num_matches));
}

// The first test that fails names the status, epipolar ones first: what depth
// says about a pair without geometry has no meaning.
PairStatus JudgePair(const PairGeometry& pair,
                     int num_epipolar_inliers,
                     const PairVerificationOptions& options) {
  const double min_num_inliers = MinNumInliers(options, pair.num_matches);
  if (num_epipolar_inliers < options.min_num_inliers) {
    return PairStatus::TOO_FEW_INLIERS;
  }
  if (num_epipolar_inliers < min_num_inliers) {
    return PairStatus::LOW_INLIER_RATIO;
  }
  if (pair.Has(PairDegeneracy::STATIONARY)) return PairStatus::STATIONARY;
  if (pair.inlier_matches.size() < min_num_inliers) {
    return PairStatus::DEPTH_INCONSISTENT;
  }
  return PairStatus::VALID;
}

}  // namespace

bool PairVerificationOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Valid(two_view)
      .Valid(depth_consistency)
      .AtLeast("min_num_inliers", min_num_inliers, 5)
      .Within("min_inlier_ratio", min_inlier_ratio, 0, 1)
      .AtLeast("depth_noise_factor", depth_noise_factor, 0)
      .AreKept();
}

PairImage CreatePairImage(const Scene& scene,
                          const colmap::Image& image,
                          const KeypointDepths* depths) {
  const auto prior = scene.focal_priors.find(image.CameraId());
  return {image,
          scene.cameras.at(image.CameraId()),
          depths,
          prior == scene.focal_priors.end() ? FocalPrior() : prior->second};
}

PairImage CreatePairImage(const Scene& scene,
                          const KeypointDepthMap& depths,
                          colmap::image_t image_id) {
  const auto it = depths.find(image_id);
  return CreatePairImage(scene,
                         scene.images.at(image_id),
                         it == depths.end() ? nullptr : &it->second);
}

PairGeometry VerifyPair(const PairImage& image1,
                        const PairImage& image2,
                        const colmap::FeatureMatches& matches,
                        const PairVerificationOptions& options,
                        const std::optional<Eigen::Quaterniond>& rotation) {
  const colmap::Camera& camera1 = image1.camera;
  const colmap::Camera& camera2 = image2.camera;
  PairGeometry pair;
  pair.num_matches = matches.size();
  if (matches.size() < size_t(options.min_num_inliers)) {
    pair.status = PairStatus::TOO_FEW_MATCHES;
    return pair;
  }

  UsableMatches usable = CollectMatches(image1, image2, matches);
  TwoViewDepthInput input;
  input.matches = std::move(usable.depth_matches);
  input.focal_case = FocalCaseOfPair(camera1, camera2);
  input.focal_length1_px = camera1.MeanFocalLength();
  input.focal_length2_px = camera2.MeanFocalLength();
  input.focal_prior1 = PriorOf(image1);
  input.focal_prior2 = PriorOf(image2);
  input.image_size1_px = double(std::max(camera1.Width(), camera1.Height()));
  input.image_size2_px = double(std::max(camera2.Width(), camera2.Height()));
  // The published estimator makes all its trials whatever they find.
  if (!options.two_view.paper) {
    input.min_num_inliers =
        int(std::ceil(MinNumInliers(options, matches.size())));
  }
  input.rotation = rotation;
  // A number of the stream that the user's seed selects, so that the result
  // depends on neither threads nor other pairs.
  input.seed = SplitMix64(
      PairIdOfImages(image1.image.ImageId(), image2.image.ImageId()) +
      0x9E3779B97F4A7C15ull * uint64_t(options.random_seed))();
  const TwoViewDepthResult result =
      EstimateTwoViewGeometryWithDepth(input, options.two_view);
  if (!result.success) {
    pair.status = PairStatus::NO_GEOMETRY;
    return pair;
  }
  CopyGeometry(result, &pair);
  SelectMatches(result, input.matches, usable.matches, options, &pair);
  pair.status = JudgePair(pair, result.num_inliers, options);
  return pair;
}

PairGeometry VerifyPair(const Scene& scene,
                        const KeypointDepthMap& depths,
                        colmap::image_pair_t pair_id,
                        const colmap::FeatureMatches& matches,
                        const PairVerificationOptions& options) {
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  return VerifyPair(CreatePairImage(scene, depths, image_id1),
                    CreatePairImage(scene, depths, image_id2),
                    matches,
                    options);
}

void SortLongestFirst(const PairGeometries& pairs,
                      std::vector<colmap::image_pair_t>* pair_ids) {
  std::stable_sort(pair_ids->begin(),
                   pair_ids->end(),
                   [&](colmap::image_pair_t a, colmap::image_pair_t b) {
                     return pairs.at(a).num_matches > pairs.at(b).num_matches;
                   });
}

PairGeometries VerifyPairs(const Scene& scene,
                           const KeypointDepthMap& depths,
                           const PairVerificationOptions& options) {
  return VerifyPairs(scene, scene.matches, depths, options);
}

PairGeometries VerifyPairs(
    const Scene& scene,
    const std::map<colmap::image_pair_t, colmap::FeatureMatches>& matches,
    const KeypointDepthMap& depths,
    const PairVerificationOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;

  struct Item {
    colmap::image_pair_t pair_id;
    const colmap::FeatureMatches* matches;
    PairGeometry* result;
  };
  PairGeometries pairs;
  std::vector<Item> items;
  for (const auto& [pair_id, pair_matches] : matches) {
    items.push_back({pair_id, &pair_matches, &pairs[pair_id]});
  }
  // Long pairs first, so that no thread starts one when the others end.
  std::stable_sort(
      items.begin(), items.end(), [](const Item& a, const Item& b) {
        return a.matches->size() > b.matches->size();
      });
  Progress progress("Verifying pairs", items.size());
  ParallelFor(items.size(), options.num_threads, [&](size_t i) {
    const Item& item = items[i];
    *item.result =
        VerifyPair(scene, depths, item.pair_id, *item.matches, options);
    progress.Step();
  });
  return pairs;
}

}  // namespace dgsfm
